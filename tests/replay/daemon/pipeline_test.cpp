#include "tests/support/replay_run.hpp"
#include "tests/support/room_drive.hpp"

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::daemon;
using tests::ReplayRun;
using tests::run_replay;
using tests::s_curve;
using tests::scans_with_imu;
using tests::TemporaryFolder;
using tests::write_room_drive;

namespace {

ReplayRun run_pipeline(const std::string& folder, int threads) {
  Config config;
  config.odometry.threads = threads;
  return run_replay(folder, config);
}

double path_error_m(const ReplayRun& run) {
  const ipc::PoseRecord& first = run.poses.front();
  const ipc::PoseRecord& last = run.poses.back();
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

TEST_CASE("a recorded drive of packets and CAN frames yields one pose per scan", "[pipeline]") {
  const TemporaryFolder folder;
  write_room_drive(folder.path(), s_curve, 4.0, true);
  const ReplayRun run = run_pipeline(folder.path().string(), 1);
  // 40 revolutions start at the cut; the end of the recording closes the last one.
  CHECK(run.poses.size() >= 39);
  CHECK(run.poses.size() == run.pipeline->scan_stats().scans);
  CHECK(run.pipeline->scan_stats().lost_packets == 0);
  // In the first turn the IMU is tested, not used.
  CHECK(scans_with_imu(run) + 16 >= run.poses.size());
  CHECK(run.clouds > 0);
  CHECK(path_error_m(run) < 0.2);
  for (std::size_t i = 1; i < run.poses.size(); ++i) {
    CHECK(run.poses[i].stamp_ns - run.poses[i - 1].stamp_ns == Approx(1e8).margin(2e6));
    for (std::size_t s = 1; s + 1 < ipc::kStageCount; ++s)
      CHECK(run.poses[i].stage_ns[s] >= run.poses[i].stage_ns[s - 1]);
  }
}

TEST_CASE("a replay is bit-identical in a second run and with two threads", "[pipeline]") {
  const TemporaryFolder folder;
  write_room_drive(folder.path(), s_curve, 1.5, true);
  const ReplayRun reference = run_pipeline(folder.path().string(), 1);
  for (const int threads : {1, 2}) {
    const ReplayRun run = run_pipeline(folder.path().string(), threads);
    REQUIRE(run.poses.size() == reference.poses.size());
    for (std::size_t i = 0; i < run.poses.size(); ++i) {
      CHECK(run.poses[i].position == reference.poses[i].position);
      CHECK(run.poses[i].orientation_xyzw == reference.poses[i].orientation_xyzw);
      CHECK(run.poses[i].stamp_ns == reference.poses[i].stamp_ns);
    }
  }
}

TEST_CASE("a drive without a CAN log is tracked at constant velocity with a warning", "[pipeline]") {
  const TemporaryFolder folder;
  write_room_drive(folder.path(), s_curve, 3.0, false);
  const auto files = find_replay_files({folder.path().string()});
  REQUIRE(files.ok());
  const auto input = open_replay(*files, Config{});
  REQUIRE(input.ok());
  REQUIRE(input->warnings.size() == 1);
  CHECK(input->warnings[0].find("no CAN log") != std::string::npos);
  const ReplayRun run = run_pipeline(folder.path().string(), 1);
  CHECK(scans_with_imu(run) == 0);
  CHECK(path_error_m(run) < 0.2);
}

TEST_CASE("an IMU log that ends half-way is used up to its end", "[pipeline]") {
  const TemporaryFolder folder;
  write_room_drive(folder.path(), s_curve, 4.0, true);
  const auto log = folder.path() / "imu.log";
  std::filesystem::resize_file(log, std::filesystem::file_size(log) / 2);
  const ReplayRun run = run_pipeline(folder.path().string(), 1);
  CHECK(scans_with_imu(run) > 4);
  CHECK(scans_with_imu(run) < 22);
  CHECK(path_error_m(run) < 0.2);
}
