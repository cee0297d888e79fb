#include "nilio/daemon/pipeline.hpp"

#include "../unit/room_drive.hpp"

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::daemon;
using tests::s_curve;
using tests::TemporaryFolder;
using tests::write_room_drive;

namespace {

struct Outcome {
  std::vector<ipc::PoseRecord> poses;
  std::uint64_t clouds = 0;
  std::uint64_t scans_with_imu = 0;
  std::uint64_t imu_samples = 0;
  drivers::ScanAssemblerStats scan_stats;
};

Outcome run_pipeline(const std::string& folder, int threads) {
  Config config;
  config.odometry.threads = threads;
  const auto files = find_replay_files({folder});
  REQUIRE(files.ok());
  auto input = open_replay(*files, config);
  REQUIRE(input.ok());
  PipelineOptions options;
  options.collect_map = true;
  auto pipeline = Pipeline::create(config, std::move(input).value(), options, nullptr);
  REQUIRE(pipeline.ok());
  REQUIRE((*pipeline)->start().ok());
  Outcome outcome;
  const auto drain = [&] {
    while (const auto record = (*pipeline)->poses().try_pop()) outcome.poses.push_back(*record);
    while ((*pipeline)->clouds().try_pop()) ++outcome.clouds;
  };
  while (!(*pipeline)->finished()) {
    (*pipeline)->output_event().wait(core::Duration::from_milliseconds(20.0));
    drain();
  }
  (*pipeline)->join();
  drain();
  outcome.scans_with_imu = (*pipeline)->counters().scans_with_imu.load();
  outcome.imu_samples = (*pipeline)->counters().imu_samples.load();
  outcome.scan_stats = (*pipeline)->scan_stats();
  return outcome;
}

double path_error_m(const Outcome& outcome) {
  const ipc::PoseRecord& first = outcome.poses.front();
  const ipc::PoseRecord& last = outcome.poses.back();
  const auto truth = [](const ipc::PoseRecord& record) {
    return s_curve(static_cast<double>(record.stamp_ns - tests::kDriveStartNs) * 1e-9);
  };
  const core::Vector3 wanted = (truth(first).inverse() * truth(last)).translation;
  const core::Vector3 a(first.position.data());
  const core::Vector3 b(last.position.data());
  const auto& q = first.orientation_xyzw;
  const core::Vector3 found = Eigen::Quaterniond(q[3], q[0], q[1], q[2]).conjugate() * (b - a);
  return (wanted - found).norm();
}

}  // namespace

TEST_CASE("a recorded drive goes from packets and CAN frames to one pose per scan", "[pipeline]") {
  const TemporaryFolder folder;
  write_room_drive(folder.path(), s_curve, 4.0, true);
  const Outcome outcome = run_pipeline(folder.path().string(), 1);
  // 40 revolutions begin at the cut; the last is closed by the end of the recording.
  CHECK(outcome.poses.size() >= 39);
  CHECK(outcome.poses.size() == outcome.scan_stats.scans);
  CHECK(outcome.scan_stats.lost_packets == 0);
  // In the first bend the IMU is judged, not used.
  CHECK(outcome.scans_with_imu + 16 >= outcome.poses.size());
  CHECK(outcome.clouds > 0);
  CHECK(path_error_m(outcome) < 0.2);
  for (std::size_t i = 1; i < outcome.poses.size(); ++i) {
    CHECK(outcome.poses[i].stamp_ns - outcome.poses[i - 1].stamp_ns == Approx(1e8).margin(2e6));
    for (std::size_t s = 1; s + 1 < ipc::kStageCount; ++s)
      CHECK(outcome.poses[i].stage_ns[s] >= outcome.poses[i].stage_ns[s - 1]);
  }
}

TEST_CASE("the same recording gives the same bits in a second run and with two threads", "[pipeline]") {
  const TemporaryFolder folder;
  write_room_drive(folder.path(), s_curve, 1.5, true);
  const Outcome reference = run_pipeline(folder.path().string(), 1);
  for (const int threads : {1, 2}) {
    const Outcome outcome = run_pipeline(folder.path().string(), threads);
    REQUIRE(outcome.poses.size() == reference.poses.size());
    for (std::size_t i = 0; i < outcome.poses.size(); ++i) {
      CHECK(outcome.poses[i].position == reference.poses[i].position);
      CHECK(outcome.poses[i].orientation_xyzw == reference.poses[i].orientation_xyzw);
      CHECK(outcome.poses[i].stamp_ns == reference.poses[i].stamp_ns);
    }
  }
}

TEST_CASE("without a CAN log the drive is tracked at constant velocity, and the lack of it is said",
          "[pipeline]") {
  const TemporaryFolder folder;
  write_room_drive(folder.path(), s_curve, 3.0, false);
  const auto files = find_replay_files({folder.path().string()});
  REQUIRE(files.ok());
  const auto input = open_replay(*files, Config{});
  REQUIRE(input.ok());
  REQUIRE(input->warnings.size() == 1);
  CHECK(input->warnings[0].find("no CAN log") != std::string::npos);
  const Outcome outcome = run_pipeline(folder.path().string(), 1);
  CHECK(outcome.scans_with_imu == 0);
  CHECK(path_error_m(outcome) < 0.2);
}

TEST_CASE("an IMU log that ends half-way is used as far as it goes", "[pipeline]") {
  const TemporaryFolder folder;
  write_room_drive(folder.path(), s_curve, 4.0, true);
  const auto log = folder.path() / "imu.log";
  std::filesystem::resize_file(log, std::filesystem::file_size(log) / 2);
  const Outcome outcome = run_pipeline(folder.path().string(), 1);
  CHECK(outcome.scans_with_imu > 4);
  CHECK(outcome.scans_with_imu < 22);
  CHECK(path_error_m(outcome) < 0.2);
}
