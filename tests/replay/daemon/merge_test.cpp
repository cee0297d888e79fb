#include "tests/support/replay_run.hpp"
#include "tests/support/two_lidars.hpp"

#include <chrono>
#include <fstream>
#include <memory>
#include <thread>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::daemon;
using namespace nilio::tests;

namespace {

/// Delays packets by 60 ms at intervals.
class LateSource final : public drivers::PacketSource {
 public:
  explicit LateSource(std::unique_ptr<drivers::PacketSource> source) : source_(std::move(source)) {}
  drivers::SourceRead read(std::span<drivers::Packet> slots, core::Duration timeout) override {
    if (++reads_ % 200 == 0) std::this_thread::sleep_for(std::chrono::milliseconds(60));
    return source_->read(slots, timeout);
  }
  [[nodiscard]] drivers::SourceStats stats() const override { return source_->stats(); }
  [[nodiscard]] std::string status() const override { return source_->status(); }

 private:
  std::unique_ptr<drivers::PacketSource> source_;
  std::size_t reads_ = 0;
};

Config one_lidar() {
  Config config = two_lidars();
  config.more_lidars[0].enabled = false;
  return config;
}

std::size_t count_lines(const ReplayRun& run, const std::string& text) {
  return static_cast<std::size_t>(
      std::count_if(run.lines.begin(), run.lines.end(),
                    [&](const EventLog::Line& line) { return line.text.find(text) != std::string::npos; }));
}

/// Root mean square error of the positions of base_link relative to the first pose.
double position_error_m(const std::vector<ipc::PoseRecord>& poses) {
  const auto pose_of = [](const ipc::PoseRecord& record) {
    const auto& q = record.orientation_xyzw;
    return core::SE3{Eigen::Quaterniond(q[3], q[0], q[1], q[2]), core::Vector3(record.position.data())};
  };
  const auto truth_of = [](const ipc::PoseRecord& record) {
    return s_curve(static_cast<double>(record.stamp_ns - kDriveStartNs) * 1e-9);
  };
  double sum = 0.0;
  for (const ipc::PoseRecord& record : poses) {
    const core::SE3 found = pose_of(poses.front()).inverse() * pose_of(record);
    const core::SE3 wanted = truth_of(poses.front()).inverse() * truth_of(record);
    sum += (found.translation - wanted.translation).squaredNorm();
  }
  return std::sqrt(sum / static_cast<double>(poses.size()));
}

/// Both LiDARs of a recording, read completely into their rings, and the merged scans.
class Scans {
 public:
  Scans(const std::filesystem::path& folder, const Config& config)
      : event_(ipc::WakeEvent::create().value()), source_(open(folder, config.lidar)) {
    const LidarConfig& second = config.more_lidars[0];
    other_source_ = open(folder, second);
    drivers::ScanAssemblerConfig partial = assembler_config(second);
    partial.min_coverage = 0.0;
    input_.emplace("lidar", config.lidar, assembler_config(config.lidar), *source_, sensor_, log_);
    other_.emplace("lidar2", second, partial, *other_source_, sensor_, log_);
    for (LidarInput* input : {&*input_, &*other_}) receive_all(*input);
    first_.emplace(input_->channel, event_);
    MergedScanFeed::Other other;
    other.channel = &other_->channel;
    other.elevation_correction_rad = elevation_correction_rad(second);
    other.T_first_other = to_transform(config.lidar.extrinsic).inverse() * to_transform(second.extrinsic);
    feed_.emplace(*first_, std::vector<MergedScanFeed::Other>{other}, MergedScanFeed::Options{}, event_,
                  log_);
  }
  MergedScanFeed& feed() { return *feed_; }
  const LidarInput& other() { return *other_; }

 private:
  void receive_all(LidarInput& input) {
    const ReceivePolicy policy;
    PacketReceiver receiver(input.source, input.ring, event_, policy, input.state);
    while (receiver.run()) {
    }
    receiver.finish();
  }
  static std::unique_ptr<drivers::PacketSource> open(const std::filesystem::path& folder,
                                                     const LidarConfig& config) {
    return drivers::open_pcap((folder / "lidar.pcap").string(), {.sender_address = config.sender_address})
        .value();
  }

  const drivers::VelodyneSensor sensor_ = drivers::make_velodyne_sensor(drivers::VelodyneModel::kVlp16);
  EventLog log_;
  ipc::WakeEvent event_;
  std::unique_ptr<drivers::PacketSource> source_;
  std::unique_ptr<drivers::PacketSource> other_source_;
  std::optional<LidarInput> input_;
  std::optional<LidarInput> other_;
  std::optional<PacketScanFeed> first_;
  std::optional<MergedScanFeed> feed_;
};

}  // namespace

TEST_CASE("points of both LiDARs in merged scans lie on the walls", "[merge][pipeline]") {
  const TemporaryFolder folder;
  write_two_lidar_drive(folder.path(), s_curve, 1.2, 1.2);
  const Config config = two_lidars();
  const Room room = Room::with_pillars();
  const core::SE3 T_base_first = to_transform(config.lidar.extrinsic);
  Scans scans(folder.path(), config);
  core::Scan scan;
  std::optional<core::Time> previous_end;
  std::size_t count = 0;
  std::size_t points = 0;
  std::size_t off_the_wall = 0;
  while (scans.feed().next(scan, core::Duration{}) == FeedState::kScan) {
    for (const core::Point& point : scan.points) {
      const core::Time time = scan.start + core::Duration{point.time_offset_ns};
      if (time > scan.end || (previous_end && time <= *previous_end)) FAIL("a point out of its scan's time");
      const double t = static_cast<double>(time.ns - kDriveStartNs) * 1e-9;
      const core::Vector3 p = s_curve(t) * (T_base_first * core::Vector3(point.x, point.y, point.z));
      off_the_wall += static_cast<std::size_t>(distance_to_surface(room, p) > 0.02);
    }
    points += scan.points.size();
    ++count;
    previous_end = scan.end;
  }
  const MergeCounters& merged = scans.feed().counters(0);
  const std::uint64_t of_first = scans.feed().stats().points;
  const std::uint64_t of_second = scans.other().channel.stats().points;
  CHECK(count >= 11);
  CHECK(off_the_wall < points / 1000);
  CHECK(merged.points_merged > of_second * 95 / 100);
  CHECK(merged.points_merged + merged.points_unused <= of_second);
  // Before the start of the first LiDAR's first scan.
  CHECK(merged.points_unused < 100);
  CHECK(points <= of_first + merged.points_merged);
  CHECK(points > of_first * 9 / 10 + merged.points_merged);
  CHECK(merged.scans_without == 0);
}

TEST_CASE("the elevation correction of a merged LiDAR rotates beams about its own centre",
          "[merge][pipeline]") {
  const TemporaryFolder folder;
  write_two_lidar_drive(folder.path(), s_curve, 0.3, 0.3);
  Config config = two_lidars();
  const core::SE3 T_other_first =
      to_transform(config.more_lidars[0].extrinsic).inverse() * to_transform(config.lidar.extrinsic);
  const auto first_scan = [&](double correction_deg) {
    config.more_lidars[0].elevation_correction_deg = correction_deg;
    Scans scans(folder.path(), config);
    core::Scan scan;
    REQUIRE(scans.feed().next(scan, core::Duration{}) == FeedState::kScan);
    return scan.points;
  };
  const auto elevation = [&](const core::Point& point) {
    const core::Vector3 p = T_other_first * core::Vector3(point.x, point.y, point.z);
    return std::atan2(p.z(), p.head<2>().norm());
  };
  const std::vector<core::Point> plain = first_scan(0.0);
  const std::vector<core::Point> raised = first_scan(1.0);
  REQUIRE(plain.size() == raised.size());
  std::size_t changed = 0;
  for (std::size_t i = 0; i < plain.size(); ++i) {
    if (plain[i].x == raised[i].x && plain[i].y == raised[i].y && plain[i].z == raised[i].z) continue;
    ++changed;
    CHECK(elevation(raised[i]) - elevation(plain[i]) == Approx(std::numbers::pi / 180.0).epsilon(0.001));
  }
  CHECK(changed > plain.size() / 3);
}

TEST_CASE("poses from two LiDARs are accurate to centimetres and bit-identical with two threads",
          "[merge][pipeline]") {
  const TemporaryFolder folder;
  write_two_lidar_drive(folder.path(), s_curve, 2.0, 2.0);
  const ReplayRun one = run_replay(folder.text(), one_lidar());
  const ReplayRun two = run_replay(folder.text(), two_lidars());
  REQUIRE(two.poses.size() == one.poses.size());
  INFO("one " << position_error_m(one.poses) << " m, two " << position_error_m(two.poses) << " m");
  CHECK(position_error_m(two.poses) < 0.03);
  CHECK(two.poses.back().points > one.poses.back().points * 3 / 2);
  CHECK(count_lines(two, "lidar2: VLP-16: return mode") == 1);
  Config config = two_lidars();
  config.odometry.threads = 2;
  const ReplayRun threads = run_replay(folder.text(), config);
  REQUIRE(threads.poses.size() == two.poses.size());
  for (std::size_t i = 0; i < two.poses.size(); ++i) {
    CHECK(threads.poses[i].position == two.poses[i].position);
    CHECK(threads.poses[i].orientation_xyzw == two.poses[i].orientation_xyzw);
    CHECK(threads.poses[i].points == two.poses[i].points);
  }
}

TEST_CASE("a run with a late second LiDAR is repeated bit by bit from its decisions", "[merge][pipeline]") {
  const TemporaryFolder folder;
  write_two_lidar_drive(folder.path(), s_curve, 3.0, 3.0);
  Config config = two_lidars();
  config.realtime.policy = "other";
  config.realtime.lock_memory = false;
  config.more_lidars[0].wait_ms = 2.0;
  const auto files = find_replay_files({folder.path().string()});
  REQUIRE(files.ok());
  auto input = open_replay(*files, config);
  REQUIRE(input.ok());
  ExtraLidar& second = input->more_lidars.front();
  second.packets = std::make_unique<LateSource>(std::move(second.packets));
  PipelineOptions as_live;
  as_live.rules = RunRules::Kind::kReplayAsLive;
  const ReplayRun live = run_input(config, std::move(input).value(), as_live);
  REQUIRE(live.decisions.size() >= live.poses.size());
  // Written and read back.
  const std::string log = (folder.path() / "decisions.jsonl").string();
  std::ofstream file(log);
  file << decision_line(DecisionHeader{core::BudgetMode::kWall, core::Duration::from_milliseconds(50.0), {}})
       << '\n';
  for (const ScanDecision& decision : live.decisions) file << decision_line(decision) << '\n';
  file.close();
  const auto decisions = read_decisions(log);
  REQUIRE(decisions.ok());
  PipelineOptions again;
  again.decisions = *decisions;
  auto same = open_replay(*files, config);
  REQUIRE(same.ok());
  const ReplayRun repeated = run_input(config, std::move(same).value(), again);
  REQUIRE(repeated.poses.size() == live.poses.size());
  std::size_t different = 0;
  for (std::size_t i = 0; i < live.poses.size(); ++i) {
    const bool is_same = repeated.poses[i].position == live.poses[i].position &&
                         repeated.poses[i].orientation_xyzw == live.poses[i].orientation_xyzw &&
                         repeated.poses[i].points == live.poses[i].points;
    different += is_same ? 0 : 1;
  }
  CHECK(different == 0);
  // Without the decisions the run differs.
  const ReplayRun plain = run_replay(folder.text(), config);
  CHECK(plain.poses.back().position != live.poses.back().position);
}

TEST_CASE("poses continue without a silent second LiDAR, which is logged once", "[merge][pipeline]") {
  const TemporaryFolder folder;
  write_two_lidar_drive(folder.path(), s_curve, 2.0, 1.0);
  const ReplayRun one = run_replay(folder.text(), one_lidar());
  const ReplayRun two = run_replay(folder.text(), two_lidars());
  CHECK(two.poses.size() == one.poses.size());
  CHECK(count_lines(two, "lidar2: no packets received; poses are computed without it") == 1);
  const MergeCounters& merged = two.pipeline->merge_counters(1);
  CHECK(merged.scans_without >= 9);
  CHECK(merged.scans_without <= 11);
  CHECK(merged.waits_timed_out == 0);
  CHECK(two.poses.back().points == one.poses.back().points);
}

TEST_CASE("LiDARs with the same packets are rejected, and one without packets is skipped",
          "[merge][pipeline]") {
  const TemporaryFolder folder;
  write_two_lidar_drive(folder.path(), s_curve, 0.4, 0.4);
  const auto files = find_replay_files({folder.path().string()});
  REQUIRE(files.ok());
  Config config = two_lidars();
  config.more_lidars[0].sender_address = config.lidar.sender_address;
  const auto same = open_replay(*files, config);
  REQUIRE_FALSE(same.ok());
  CHECK(same.error().message.find("lidar and lidar2 receive the same packets") != std::string::npos);
  config.more_lidars[0].sender_address = "192.168.1.77";
  const auto lacking = open_replay(*files, config);
  REQUIRE(lacking.ok());
  CHECK(lacking->more_lidars.empty());
  REQUIRE_FALSE(lacking->warnings.empty());
  CHECK(lacking->warnings.front().find("lidar2: no packets in the recording") == 0);
}
