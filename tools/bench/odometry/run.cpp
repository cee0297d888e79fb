#include "tools/bench/odometry/run.hpp"

#include "daemon/output/sha256.hpp"
#include "tools/bench/common/memory_use.hpp"
#include "tools/bench/common/replay.hpp"
#include "tools/common/progress.hpp"

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <utility>

namespace nilio::tools::bench {

namespace {

namespace fs = std::filesystem;
using core::Error;
using core::Result;

constexpr std::uint64_t kProgressParts = 1000;

/// Share of the drive that is done, by the truth's length: a recording's own is not known before its end.
std::uint64_t done_parts(const Trajectory& truth, std::uint64_t scans, core::Time scan_end) {
  if (truth.format == TrajectoryFormat::kKitti) return kProgressParts * scans / truth.poses.size();
  const double length = (truth.stamps.back() - truth.stamps.front()).seconds();
  const double done = (scan_end - truth.stamps.front()).seconds();
  if (length <= 0.0) return 0;
  return static_cast<std::uint64_t>(static_cast<double>(kProgressParts) *
                                    std::clamp(done / length, 0.0, 1.0));
}

/// Splits "FOLDER:TRUTH"; without a truth, looks for one in the folder.
Result<std::pair<std::string, std::string>> split_argument(const std::string& argument) {
  const std::size_t colon = argument.rfind(':');
  if (colon != std::string::npos && !fs::exists(argument))
    return std::pair(argument.substr(0, colon), argument.substr(colon + 1));
  for (const char* name : {"truth.tum", "poses.txt"}) {
    const fs::path path = fs::path(argument) / name;
    if (fs::exists(path)) return std::pair(argument, path.string());
  }
  return Error{argument + ": has neither truth.tum nor poses.txt - name the truth as " + argument +
               ":FILE (TUM or KITTI)"};
}

}  // namespace

Result<BenchDataset> open_bench_dataset(const std::string& argument) {
  Result<std::pair<std::string, std::string>> paths = split_argument(argument);
  if (!paths) return paths.error();
  BenchDataset dataset;
  fs::path folder(paths->first);
  if (folder.filename().empty()) folder = folder.parent_path();
  dataset.name = folder.filename().string();
  Result<daemon::ReplayFiles> files = daemon::find_replay_files({paths->first});
  if (!files) return files.error();
  dataset.files = std::move(files).value();
  Result<Trajectory> truth = read_trajectory(paths->second);
  if (!truth) return truth.error();
  dataset.truth = std::move(truth).value();
  return dataset;
}

Result<daemon::Config> bench_config(const BenchDataset& dataset, const std::vector<std::string>& overrides) {
  return recording_config(dataset.files, overrides);
}

Trajectory make_trajectory(const BenchDataset& dataset, const BenchRun& run,
                           std::span<const core::SE3> poses) {
  Trajectory trajectory;
  trajectory.format = dataset.truth.format;
  trajectory.path = dataset.name;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    core::SE3 pose = poses[i];
    if (trajectory.format == TrajectoryFormat::kKitti) {
      pose = run.T_camera_base * poses.front().inverse() * pose * run.T_camera_base.inverse();
    } else {
      trajectory.stamps.push_back(run.results[i].scan_end);
    }
    trajectory.poses.emplace_back(pose.matrix());
  }
  return trajectory;
}

Result<BenchRun> run_odometry(const BenchDataset& dataset, const daemon::Config& config,
                              core::Odometry::ClockFunction clock, const daemon::ScanObserver& observer) {
  BenchRun run;
  run.resident_before_bytes = reset_peak_resident();
  Progress progress(dataset.name, kProgressParts);
  std::uint64_t scans = 0;
  const auto observe = [&](const core::Scan& scan, const core::OdometryResult& result,
                           const core::Odometry& odometry) {
    progress.update(done_parts(dataset.truth, ++scans, scan.end));
    if (observer) observer(scan, result, odometry);
  };
  Result<Replay> replayed = replay(dataset.files, config, clock, observe);
  if (!replayed) return replayed.error();
  if (replayed->results.size() < 2)
    return Error{dataset.name + ": has fewer than two scans to register - give a longer recording"};
  if (replayed->T_camera_lidar)
    run.T_camera_base = *replayed->T_camera_lidar * replayed->T_base_lidar.inverse();
  run.results = std::move(replayed->results);
  run.scans_with_imu = replayed->scans_with_imu;
  run.peak_resident_bytes = peak_resident();
  std::vector<core::SE3> poses;
  for (const core::OdometryResult& result : run.results) poses.push_back(result.T_odom_base);
  run.trajectory = make_trajectory(dataset, run, poses);
  run.sha256 = daemon::sha256(replayed->tum);
  return run;
}

}  // namespace nilio::tools::bench
