#include "tools/evaluate/error_series.hpp"
#include "tools/view/http_request.hpp"
#include "tools/view/live_content.hpp"
#include "tools/view/live_path.hpp"
#include "tools/view/live_state.hpp"
#include "tools/view/metrics.hpp"
#include "tools/view/point_tiles.hpp"

#include <cmath>
#include <cstring>
#include <limits>
#include <string>

#include <catch2/catch.hpp>

namespace nilio::tools {
namespace {

dds::PointCloud2 cloud_of(const std::vector<float>& numbers) {
  dds::PointCloud2 cloud;
  cloud.fields = {{"x", 0}, {"y", 4}, {"z", 8}, {"intensity", 12}};
  cloud.point_step = 16;
  cloud.width = static_cast<std::uint32_t>(numbers.size() / 4);
  cloud.row_step = 16 * cloud.width;
  cloud.data.resize(numbers.size() * sizeof(float));
  std::memcpy(cloud.data.data(), numbers.data(), cloud.data.size());
  return cloud;
}

TEST_CASE("a cloud gives its finite points, and none where its sizes contradict each other", "[view]") {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  dds::PointCloud2 cloud = cloud_of({1, 2, 3, 300, nan, 0, 0, 5, 4, 5, 6, 7});
  const auto points = view::points_of(cloud);
  REQUIRE(points.size() == 2);
  CHECK(points[0].intensity == 255);
  CHECK(points[1].position == std::array<float, 3>{4, 5, 6});
  cloud.width = 0xFFFFFFFF;
  CHECK(view::points_of(cloud).empty());
  cloud = cloud_of({1, 2, 3, 4});
  cloud.fields[2].offset = 14;
  CHECK(view::points_of(cloud).empty());
}

TEST_CASE("tiles keep one point a voxel, drop the oldest at the limit, and ignore damaged positions",
          "[view]") {
  view::PointTiles tiles({.voxel_m = 0.5, .max_points = 3});
  tiles.add({10, 10, 0}, 1);
  tiles.add({10.1F, 10.1F, 0.1F}, 2);
  CHECK(tiles.points() == 1);
  tiles.add({std::numeric_limits<float>::infinity(), 0, 0}, 0);
  tiles.add({1e30F, 0, 0}, 0);
  CHECK(tiles.points() == 1);
  for (const float x : {100.0F, 101.0F, 102.0F}) tiles.add({x, 0, 0}, 0);
  CHECK(tiles.tiles().size() == 1);
  CHECK(tiles.dropped() == 1);
  const auto& [id, tile] = *tiles.tiles().begin();
  const view::PackedPoint& first = tile.points.front();
  CHECK(tile.origin[0] + 0.01 * first.x == Approx(100.0).margin(0.006));
  const view::FramePtr frame = view::tile_frame(tile, 1, view::PointValue::kIntensity, 0.0F);
  CHECK(frame->size() == sizeof(view::FrameHeader) + 2 * sizeof(view::PackedPoint));
}

TEST_CASE("a path stays bounded and says when vertices were removed", "[view]") {
  view::LivePath path;
  const std::uint64_t before = path.generation();
  for (std::size_t i = 0; i <= view::LivePath::kMaxVertices; ++i)
    path.add({.position = {static_cast<float>(i), 0, 0}});
  CHECK(path.vertices().size() <= view::LivePath::kMaxVertices / 2 + 1);
  CHECK(path.generation() == before + 1);
  const std::size_t count = path.vertices().size();
  path.add(path.vertices().back());
  CHECK(path.vertices().size() == count);
}

TEST_CASE("only plain paths are looked up, and a token is compared as a whole", "[view]") {
  CHECK(view::is_plain_path("/data/map0"));
  for (const char* path : {"", "x", "/../etc/passwd", "/a%2e", "/a b", "/a\\b"})
    CHECK_FALSE(view::is_plain_path(path));
  CHECK_FALSE(view::is_plain_path("/" + std::string(2000, 'a')));
  CHECK_FALSE(view::is_plain_path(std::string_view("/a\0b", 4)));
  CHECK(view::host_name("localhost:8480") == "localhost");
  CHECK(view::host_name("[::1]:8480") == "::1");
  CHECK(view::host_name("[").empty());
  CHECK(view::is_bearer("Bearer secret", "secret"));
  CHECK_FALSE(view::is_bearer("Bearer secre", "secret"));
  CHECK_FALSE(view::is_bearer("secret", "secret"));
  const std::string text(100'000, 'x');
  CHECK(view::gunzip(view::gzip(text)).value() == text);
  CHECK_FALSE(view::gunzip("no gzip"));
}

dds::ScanReport report_of(std::uint64_t sequence, const std::string& state) {
  dds::ScanReport report;
  report.sequence = sequence;
  report.stamp = core::Time{static_cast<std::int64_t>(sequence) * 100'000'000};
  report.scan_start = report.stamp - core::Duration{100'000'000};
  report.state = state;
  report.degradation_level = "full";
  const std::int64_t base = 1'000'000'000 + report.stamp.ns;
  for (const auto& [name, ms] : {std::pair{"received", 0},
                                 {"popped", 1},
                                 {"completed", 2},
                                 {"started", 3},
                                 {"filtered", 5},
                                 {"coarse", 5},
                                 {"fine", 9},
                                 {"delivered", 10},
                                 {"taken", 11},
                                 {"written", 12}})
    report.stages.push_back({name, base + ms * 1'000'000});
  report.overshoot_ns = -40'000'000;
  return report;
}

TEST_CASE("reports give the budget, the percentiles of the stages, and events", "[view]") {
  view::LiveState state("DDS domain 1");
  state.tick(1);
  state.add(report_of(1, "initialising"));
  state.add(report_of(2, "tracking"));
  CHECK(state.budget_ms() == Approx(50.0));
  const Percentiles written =
      state.window().percentiles(view::StageWindow::index_of("received_to_written"), 1, 1'000'000'000);
  CHECK(written.median == Approx(12.0));
  CHECK(state.real_time_ratio() == Approx(0.07));
  const std::uint64_t events = state.last_event();
  CHECK(events >= 2);
  // A smaller number is that of another niliod.
  const std::uint64_t drive = state.drive();
  state.add(report_of(1, "tracking"));
  CHECK(state.drive() == drive + 1);
  CHECK_FALSE(state.is_alive());
  CHECK_FALSE(state.why_silent().empty());
}

TEST_CASE("text of the network becomes valid text of bounded length", "[view]") {
  CHECK(view::clean_text("a\nb\x7F") == "a b ");
  CHECK(view::clean_text(std::string(1000, 'a'), 10).size() == 10);
  CHECK(view::clean_text("\xFF") == "\xEF\xBF\xBD");
}

TEST_CASE("buckets of a stage are folded into the fixed ones without loss", "[view]") {
  view::LiveState state("DDS domain 1");
  dds::LatencyReport report;
  report.poses_published = 7;
  report.stages.push_back(
      {.name = "fine", .count = 3, .buckets = {{90, 100, 1}, {1000, 1100, 1}, {2e6, 3e6, 1}}});
  state.set(report);
  for (const auto format : {view::MetricsFormat::kPrometheus, view::MetricsFormat::kOpenMetrics}) {
    const std::string text = view::metrics_text(state, {}, 0, format);
    CHECK(text.find("nilio_stage_seconds_bucket{stage=\"fine\",le=\"0.0001\"} 1\n") != std::string::npos);
    CHECK(text.find("nilio_stage_seconds_bucket{stage=\"fine\",le=\"0.001\"} 1\n") != std::string::npos);
    CHECK(text.find("nilio_stage_seconds_bucket{stage=\"fine\",le=\"0.002\"} 2\n") != std::string::npos);
    CHECK(text.find("nilio_stage_seconds_bucket{stage=\"fine\",le=\"+Inf\"} 3\n") != std::string::npos);
    CHECK(text.find("nilio_stage_seconds_count{stage=\"fine\"} 3\n") != std::string::npos);
    CHECK(text.find("nilio_poses_total 7\n") != std::string::npos);
    // A drive that is not there has no gauges.
    CHECK(text.find("nilio_pose_age_seconds") == std::string::npos);
    CHECK(text.ends_with("# EOF\n") == (format == view::MetricsFormat::kOpenMetrics));
  }
}

TEST_CASE("single errors are those behind the statistics of an evaluation", "[view]") {
  evaluate::PosePairs pairs;
  for (std::size_t i = 0; i < 50; ++i) {
    const auto k = static_cast<double>(i);
    Pose truth = Pose::Identity();
    truth.translation() = Eigen::Vector3d(k, 0.1 * k, 0.0);
    Pose estimate = truth;
    estimate.translation().y() += 0.01 * k;
    estimate.rotate(Eigen::AngleAxisd(0.002 * k, Eigen::Vector3d::UnitZ()));
    pairs.truth.push_back(truth);
    pairs.estimate.push_back(estimate);
    pairs.estimate_index.push_back(i);
  }
  const evaluate::Evaluation evaluation = evaluate::evaluate(pairs, {});
  const auto absolute = evaluate::absolute_errors(pairs, evaluate::Alignment::kOrigin);
  CHECK(evaluate::compute_statistics(absolute.translation_m).rmse ==
        Approx(evaluation.absolute.front().errors.translation_m.rmse));
  const auto relative = evaluate::relative_errors(pairs, {});
  CHECK(relative.pair.front() == 1);
  CHECK(evaluate::compute_statistics(relative.rotation_deg).max ==
        Approx(evaluation.relative.rotation_deg.max));
  const auto ten_metres = evaluate::relative_errors(pairs, {1, 10.0});
  CHECK(ten_metres.pair.front() == 10);
  CHECK(evaluate::roll_pitch_yaw_deg(pairs.estimate)[2].back() == Approx(0.098 * 180.0 / M_PI));
}

}  // namespace
}  // namespace nilio::tools
