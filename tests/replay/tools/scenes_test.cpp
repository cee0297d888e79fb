#include "tests/support/temporary_folder.hpp"
#include "tests/support/tools/run_command.hpp"
#include "tools/bench/odometry/measure.hpp"
#include "tools/bench/odometry/run.hpp"
#include "tools/commands/commands.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::tools;
using namespace nilio::tools::bench;
using core::OdometryResult;
using core::TrackingState;
using tests::run_command;
using tests::TemporaryFolder;

namespace {

struct SceneRun {
  std::vector<OdometryResult> results;
  Accuracy accuracy;

  [[nodiscard]] auto count(TrackingState state) const {
    return std::count_if(results.begin(), results.end(),
                         [&](const OdometryResult& r) { return r.state == state; });
  }
  [[nodiscard]] auto predicted() const {
    return std::count_if(results.begin(), results.end(), [](const OdometryResult& r) { return r.predicted; });
  }
};

/// Simulates a VLP-16 drive through a scene and registers it as niliod does.
SceneRun drive(const std::string& scene, std::vector<std::string> options) {
  const TemporaryFolder folder;
  const std::string path = folder.file(scene);
  std::vector<std::string> arguments{"simulate", path, "--realism", "ideal", "--scene", scene};
  arguments.insert(arguments.end(), options.begin(), options.end());
  REQUIRE(run_command(add_simulate_command, arguments) == 0);
  const auto dataset = open_bench_dataset(path);
  REQUIRE(dataset.ok());
  const auto config = bench_config(*dataset, {});
  REQUIRE(config.ok());
  const auto run = run_odometry(*dataset, *config, nullptr, {});
  REQUIRE(run.ok());
  const auto accuracy = measure_accuracy(dataset->truth, run->trajectory);
  REQUIRE(accuracy.ok());
  return {run->results, *accuracy};
}

}  // namespace

TEST_CASE("a bare tunnel is reported as degenerate along its axis, and tracking continues behind it",
          "[scenes][drives]") {
  for (const char* imu : {"xsens_mti", "none"}) {
    CAPTURE(imu);
    const SceneRun run = drive("tunnel", {"--imu", imu});
    CHECK(run.count(TrackingState::kDegraded) > 60);
    int along = 0;
    int other = 0;
    double widest_m = 0.0;
    for (const OdometryResult& result : run.results) {
      along += result.degenerate_axes & 1U;
      other += (result.degenerate_axes & 0b110U) != 0 ? 1 : 0;
      widest_m = std::max(widest_m, std::sqrt(result.pose_covariance(0, 0)));
    }
    CHECK(along > 60);
    CHECK(other == 0);
    // 15 s of driving at the last known speed, or as the accelerometer measures.
    const bool has_imu = std::string_view(imu) != "none";
    CHECK(widest_m > (has_imu ? 0.3 : 1.0));
    const auto behind = run.results.end() - 40;
    CHECK(std::count_if(behind, run.results.end(),
                        [](const OdometryResult& r) { return r.state == TrackingState::kTracking; }) >= 38);
    // Without an IMU nothing measures the speed in the tunnel, and its end is a jump that is said.
    if (!has_imu) continue;
    CHECK(run.count(TrackingState::kLost) == 0);
    CHECK(run.accuracy.end_drift_percent < 1.0);
  }
}

TEST_CASE("a car park's ramps, a forest and hard manoeuvres are tracked throughout", "[scenes][drives]") {
  struct Expected {
    const char* scene;
    const char* duration;
    double translation_percent;
  };
  for (const Expected& expected :
       {Expected{"ramps", "45", 0.2}, Expected{"forest", "20", 0.3}, Expected{"manoeuvres", "20", 0.3}}) {
    CAPTURE(expected.scene);
    const SceneRun run = drive(expected.scene, {"--duration", expected.duration});
    CHECK(run.count(TrackingState::kLost) == 0);
    CHECK(run.predicted() == 0);
    CHECK(run.count(TrackingState::kTracking) > 100);
    REQUIRE(run.accuracy.near);
    CHECK(run.accuracy.near->translation_percent < expected.translation_percent);
  }
}

TEST_CASE("traffic on a highway does not displace the pose", "[scenes][drives]") {
  const SceneRun run = drive("highway", {"--sensor", "hdl64e", "--duration", "30"});
  CHECK(run.count(TrackingState::kLost) == 0);
  REQUIRE(run.accuracy.far);
  CHECK(run.accuracy.far->translation_percent < 0.5);
}

TEST_CASE("a departure among faster traffic is tracked, with an IMU", "[scenes][drives]") {
  for (const char* seed : {"1", "3"}) {
    CAPTURE(seed);
    const SceneRun run = drive("highway", {"--duration", "12", "--seed", seed});
    CHECK(run.count(TrackingState::kLost) == 0);
    REQUIRE(run.accuracy.near);
    CHECK(run.accuracy.near->translation_percent < 1.0);
  }
}

TEST_CASE("the pose of a parked car stays constant while traffic passes and a bus stops beside it",
          "[scenes][drives]") {
  const SceneRun run = drive("standstill", {"--duration", "30"});
  CHECK(run.count(TrackingState::kTracking) + run.count(TrackingState::kInitialising) ==
        static_cast<std::ptrdiff_t>(run.results.size()));
  // Means of one second, since single poses have the noise of the ranges.
  const auto mean_place = [&](std::size_t first) {
    core::Vector3 sum = core::Vector3::Zero();
    for (std::size_t i = first; i < first + 10; ++i) sum += run.results[i].T_odom_base.translation;
    return core::Vector3(sum / 10.0);
  };
  for (std::size_t first = 20; first + 10 <= run.results.size(); first += 10) {
    CAPTURE(first);
    // The bus hides half of the view.
    CHECK((mean_place(first) - mean_place(10)).norm() < 0.025);
  }
  CHECK((mean_place(run.results.size() - 10) - mean_place(10)).norm() < 0.01);
  // The map is not updated while stationary, except once or twice by an apparent motion.
  CHECK(run.results.back().map_voxels < 1.1 * run.results[20].map_voxels);
}
