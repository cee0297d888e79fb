#include "nilio/drivers/imu/decoder.hpp"

#include "daemon/config/schema.hpp"
#include "daemon/input/replay_files.hpp"
#include "daemon/odometry/pipeline.hpp"
#include "tests/realtime/replayed_drive.hpp"
#include "tests/realtime/watch.hpp"
#include "tests/support/eventually.hpp"
#include "tests/support/udp_support.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <thread>

#include <catch2/catch.hpp>

using namespace nilio;
using daemon::ThreadRole;
namespace watch = tests::watch;

namespace {

// Velocity and map are established, and all buffers have their final size.
constexpr std::uint64_t kWarmUpScans = 20;

daemon::Config drive_config(int threads) {
  daemon::Config config;
  REQUIRE(daemon::apply_yaml(config, tests::town_configuration(), "the drive's nilio.yaml").ok());
  config.realtime.policy = "other";
  config.realtime.lock_memory = false;
  config.odometry.threads = threads;
  // The drive leaves this radius several times.
  config.odometry.map_radius_m = 40.0;
  config.lidar.max_range_m = 60.0;
  return config;
}

struct Drive {
  std::size_t times = 1;
  tests::Faults faults;
  double speed = 0.0;
};

daemon::Input memory_input(const Drive& drive) {
  const tests::Recording& recording = tests::town_drive();
  daemon::Input input;
  input.packets = std::make_unique<tests::RepeatedPackets>(recording, drive.times, drive.faults, drive.speed);
  input.sensor = drivers::make_velodyne_sensor(drivers::VelodyneModel::kVlp16);
  input.frames = std::make_unique<tests::RepeatedFrames>(recording, drive.times, drive.faults);
  const auto preset = drivers::imu_preset("xsens_mti");
  REQUIRE(preset.ok());
  auto decoder = drivers::ImuDecoder::create(preset->mapping, preset->database);
  REQUIRE(decoder.ok());
  input.imu_decoder.emplace(std::move(decoder).value());
  return input;
}

struct Outcome {
  std::uint64_t scans = 0;
  std::uint64_t poses = 0;
  std::uint64_t superseded = 0;
  std::uint64_t with_imu = 0;
  std::uint64_t watched_scans = 0;
  std::uint64_t published = 0;
  std::size_t workers = 0;
  drivers::ScanAssemblerStats stats;
  std::array<std::uint64_t, 4> states{};
  std::array<std::uint64_t, core::kDegradationLevels> degradation_levels{};
  std::uint64_t guarded = 0;
  std::uint64_t points_merged = 0;
};

/// Pose ring in shared memory with a reader in this process.
std::unique_ptr<ipc::PublisherProcess> make_publisher() {
  ipc::PublisherProcessConfig config;
  config.executable = "/nonexistent";
  auto publisher = ipc::PublisherProcess::create(config);
  REQUIRE(publisher.ok());
  return std::move(publisher).value();
}

void take_outputs(daemon::Pipeline& pipeline, ipc::Ring<ipc::PoseRecord>& published, Outcome& outcome) {
  while (const auto record = pipeline.poses().try_pop()) {
    ++outcome.states[static_cast<std::size_t>(record->state) % outcome.states.size()];
    ++outcome.degradation_levels[static_cast<std::size_t>(record->degradation_level) %
                                 outcome.degradation_levels.size()];
    if (record->guarded) ++outcome.guarded;
  }
  while (published.try_pop()) ++outcome.published;
  while (pipeline.clouds().try_pop()) {
  }
  while (pipeline.imu_health().try_pop()) {
  }
  while (pipeline.decisions().try_pop()) {
  }
  while (pipeline.event_log().take()) {
  }
}

/// Settings of a run besides its input.
struct Run {
  daemon::RunRules rules = {};
  daemon::ScanObserver observer = {};
  /// Feeds the pipeline from the calling thread; the default input needs no feeding.
  std::function<void(daemon::Pipeline&, const std::function<void()>& look_after)> feed = {};
};

/// Runs the pipeline and watches its threads from scan `kWarmUpScans` to the end.
Outcome run_watched(const daemon::Config& config, daemon::Input input, const Run& run = {}) {
  const auto publisher = make_publisher();
  auto published = ipc::Ring<ipc::PoseRecord>::attach(publisher->ring().file_descriptor());
  REQUIRE(published.ok());
  daemon::PipelineOptions options;
  options.rules = run.rules;
  options.collect_clouds = true;
  options.thread_hook = watch::hook;
  options.observer = run.observer;
  auto created = daemon::Pipeline::create(config, std::move(input), options, publisher.get());
  REQUIRE(created.ok());
  daemon::Pipeline& pipeline = **created;
  watch::reset();
  REQUIRE(pipeline.start().ok());
  Outcome outcome;
  std::optional<std::uint64_t> armed_at;
  const auto look_after = [&] {
    if (!armed_at && pipeline.counters().poses.load() >= kWarmUpScans) {
      armed_at = pipeline.counters().scans.load();
      watch::arm(true);
    }
    take_outputs(pipeline, *published, outcome);
  };
  if (run.feed) run.feed(pipeline, look_after);
  while (!pipeline.finished()) {
    pipeline.output_event().wait(core::Duration::from_milliseconds(20.0));
    look_after();
  }
  watch::arm(false);
  pipeline.join();
  take_outputs(pipeline, *published, outcome);
  const daemon::OdometryCounters& counters = pipeline.counters();
  outcome.scans = counters.scans.load();
  outcome.poses = counters.poses.load();
  outcome.superseded = counters.superseded.load();
  outcome.with_imu = counters.scans_with_imu.load();
  outcome.watched_scans = outcome.scans - armed_at.value_or(outcome.scans);
  outcome.workers = watch::workers_seen();
  outcome.stats = pipeline.scan_stats();
  if (pipeline.lidars().size() > 1) outcome.points_merged = pipeline.merge_counters(1).points_merged;
  return outcome;
}

void check_nothing_was_done() {
  INFO(watch::report());
  for (const ThreadRole role : {ThreadRole::kLidarReceive, ThreadRole::kImuReceive,
                                ThreadRole::kDeadlineGuard, ThreadRole::kOdometry}) {
    const tests::OffenceCounts counts = watch::counts(role);
    CAPTURE(daemon::name_of(role));
    for (std::size_t i = 0; i < counts.size(); ++i) {
      CAPTURE(tests::name_of(static_cast<tests::Offence>(i)));
      CHECK(counts[i] == 0);
    }
  }
}

}  // namespace

TEST_CASE("2000 scans with all sensor and network faults are registered without allocation, lock or throw",
          "[realtime_pipeline][drives]") {
  Drive drive;
  drive.times = 3;
  drive.faults.enabled = true;
  const Outcome outcome = run_watched(drive_config(1), memory_input(drive));
  check_nothing_was_done();
  CHECK(outcome.watched_scans >= 2000);
  CHECK(outcome.published == outcome.poses);
  // The injected faults took effect.
  CHECK(outcome.stats.time_jumps + outcome.stats.host_clock_jumps >= 2);
  CHECK(outcome.stats.lost_packets > 1000);
  CHECK(outcome.stats.bad_length > 100);
  CHECK(outcome.stats.firings_bad > 1000);
  CHECK(outcome.with_imu > 500);
  CHECK(outcome.with_imu < outcome.poses);
}

TEST_CASE("registration with two threads and NDT before every ICP does not allocate, lock or throw",
          "[realtime_pipeline][drives]") {
  daemon::Config config = drive_config(2);
  config.odometry.coarse = "always";
  Drive drive;
  drive.faults.enabled = true;
  const Outcome outcome = run_watched(config, memory_input(drive));
  check_nothing_was_done();
  // TBB sometimes fills its pools; a computer with one CPU has no worker.
  const tests::OffenceCounts of_tbb = watch::tbb_counts();
  CAPTURE(of_tbb);
  CHECK(watch::total(of_tbb) * 10 <= outcome.watched_scans);
  CHECK(outcome.watched_scans >= 600);
  CHECK(outcome.workers >= (std::thread::hardware_concurrency() > 1 ? 1U : 0U));
}

TEST_CASE("a drive read from its files is registered without allocation, lock or throw",
          "[realtime_pipeline][drives]") {
  const auto files = daemon::find_replay_files({tests::town_folder()});
  REQUIRE(files.ok());
  const daemon::Config config = drive_config(1);
  auto input = daemon::open_replay(*files, config);
  REQUIRE(input.ok());
  const Outcome outcome = run_watched(config, std::move(input).value());
  check_nothing_was_done();
  CHECK(outcome.watched_scans >= 700);
}

TEST_CASE("scans faster than the registration are superseded without allocation, lock or throw",
          "[realtime_pipeline][drives]") {
  Drive drive;
  drive.faults.enabled = true;
  // 80 s of data in 2 s.
  drive.speed = 40.0;
  const Outcome outcome =
      run_watched(drive_config(1), memory_input(drive), {.rules = daemon::RunRules::Kind::kLive});
  check_nothing_was_done();
  CHECK(outcome.superseded > 0);
  CHECK(outcome.watched_scans > 300);
}

TEST_CASE("every degradation level of the budget works without allocation, lock or throw",
          "[realtime_pipeline][drives]") {
  Drive drive;
  drive.faults.enabled = true;
  for (const double budget_ms : {0.8, 0.3, 0.2}) {
    INFO("counted work, budget " << budget_ms << " ms");
    daemon::Config config = drive_config(1);
    config.odometry.budget = "ops";
    config.odometry.budget_ms = budget_ms;
    const Outcome outcome = run_watched(config, memory_input(drive));
    check_nothing_was_done();
    CHECK(outcome.watched_scans >= 600);
    CHECK(outcome.published == outcome.poses);
    CHECK(outcome.degradation_levels[static_cast<std::size_t>(core::DegradationLevel::kFull)] < 100);
  }
}

TEST_CASE("the guard keeps an unreachable budget without allocation, lock or throw",
          "[realtime_pipeline][drives]") {
  daemon::Config config = drive_config(1);
  config.odometry.budget_ms = 0.2;
  Drive drive;
  drive.faults.enabled = true;
  drive.speed = 10.0;
  const Outcome outcome = run_watched(config, memory_input(drive), {.rules = daemon::RunRules::Kind::kLive});
  check_nothing_was_done();
  CHECK(outcome.watched_scans > 300);
  CHECK(outcome.published == outcome.poses);
  CHECK(outcome.degradation_levels[static_cast<std::size_t>(core::DegradationLevel::kPredictionOnly)] > 100);
}

TEST_CASE("a live LiDAR is identified, falls silent and returns without allocation, lock or throw",
          "[realtime_pipeline][drives]") {
  daemon::Config config = drive_config(1);
  const std::uint16_t port = tests::free_port();
  config.lidar.model = "auto";
  config.lidar.bind_address = "127.0.0.1";
  config.lidar.port = port;
  config.lidar.position_port = 0;
  config.imu.enabled = false;
  auto input = daemon::open_live(config);
  REQUIRE(input.ok());
  tests::UdpSender sender;
  Run run;
  run.rules = daemon::RunRules::Kind::kLive;
  run.feed = [&](daemon::Pipeline& pipeline, const std::function<void()>& look_after) {
    const std::vector<drivers::Packet>& packets = tests::town_drive().packets;
    constexpr std::size_t kPackets = 15'000;
    std::uint64_t sent = 0;
    // Sends no faster than packets are read: socket and ring lose none, and no scan is superseded.
    const auto let_them_be_taken = [&] {
      const daemon::LidarInput& lidar = *pipeline.lidars()[0];
      REQUIRE(tests::eventually(
          [&] {
            look_after();
            return lidar.source.stats().delivered >= sent && lidar.ring.size() == 0;
          },
          std::chrono::microseconds(500)));
    };
    for (std::size_t i = 0; i < kPackets; ++i) {
      const drivers::Packet& packet = packets[i];
      sender.send(port, {packet.data.begin(), packet.data.begin() + packet.size});
      ++sent;
      // A pause in the middle exceeds every wait; datagrams of wrong lengths are included.
      if (i == kPackets / 2) std::this_thread::sleep_for(std::chrono::milliseconds(700));
      if (i % 1000 == 999) {
        sender.send(port, std::vector<std::uint8_t>(i % 1400));
        ++sent;
      }
      if (i % 32 == 31) let_them_be_taken();
    }
    let_them_be_taken();
    std::this_thread::sleep_for(std::chrono::milliseconds(200));
    look_after();
    watch::arm(false);
    pipeline.request_stop();
  };
  const Outcome outcome = run_watched(config, std::move(input).value(), run);
  check_nothing_was_done();
  CHECK(outcome.watched_scans > 100);
  CHECK(outcome.stats.bad_length >= 10);
}

TEST_CASE("scans of two LiDARs are merged without allocation, lock or throw", "[realtime_pipeline][drives]") {
  Drive drive;
  drive.faults.enabled = true;
  daemon::Input input = memory_input(drive);
  daemon::ExtraLidar second;
  second.section = "lidar2";
  // Slightly later than the first LiDAR and with different losses.
  second.config.extrinsic = {{-1.5, 0.0, 0.0}, {0.0, 0.0, 30.0}};
  second.packets =
      std::make_unique<tests::RepeatedPackets>(tests::town_drive(), drive.times, tests::Faults{});
  second.sensor = drivers::make_velodyne_sensor(drivers::VelodyneModel::kVlp16);
  input.more_lidars.push_back(std::move(second));
  const Outcome outcome = run_watched(drive_config(1), std::move(input));
  check_nothing_was_done();
  CHECK(outcome.watched_scans >= 600);
  CHECK(outcome.points_merged > 10'000'000);
}

TEST_CASE("a planted allocation in the odometry thread of a pipeline is detected and named",
          "[realtime_pipeline][drives]") {
  Run run;
  std::unique_ptr<int> planted;
  run.observer = [&](const core::Scan& scan, const core::OdometryResult&, const core::Odometry&) {
    if (scan.sequence == 200) planted = std::make_unique<int>(7);
  };
  Drive drive;
  const Outcome outcome = run_watched(drive_config(1), memory_input(drive), run);
  CHECK(outcome.watched_scans > 600);
  REQUIRE(planted);
  const tests::OffenceCounts counts = watch::counts(ThreadRole::kOdometry);
  CHECK(counts[static_cast<std::size_t>(tests::Offence::kAllocation)] == 1);
  CHECK(watch::total(counts) == 1);
  CHECK(watch::report().find("allocation in nilio-odometry") == 0);
}
