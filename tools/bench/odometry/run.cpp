#include "tools/bench/odometry/run.hpp"

#include "daemon/config/convert.hpp"
#include "daemon/config/schema.hpp"
#include "daemon/input/input.hpp"
#include "daemon/odometry/pipeline.hpp"
#include "daemon/output/run_output.hpp"
#include "daemon/output/sha256.hpp"
#include "tools/bench/common/memory_use.hpp"
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

constexpr core::Duration kPoll = core::Duration::from_milliseconds(20.0);
constexpr std::uint64_t kProgressParts = 1000;

/// Share of the drive that is done, by the truth's length: a recording's own is not known before its end.
std::uint64_t done_parts(const Trajectory& truth, const std::vector<core::OdometryResult>& results) {
  if (truth.format == TrajectoryFormat::kKitti) return kProgressParts * results.size() / truth.poses.size();
  const double length = (truth.stamps.back() - truth.stamps.front()).seconds();
  const double done = (results.back().scan_end - truth.stamps.front()).seconds();
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
  daemon::Config config;
  daemon::apply_recording_defaults(dataset.files, config);
  if (!dataset.files.configuration.empty()) {
    const auto applied = daemon::apply_file(config, dataset.files.configuration);
    if (!applied) return applied.error();
  }
  const auto applied = daemon::apply_overrides(config, overrides);
  if (!applied) return applied.error();
  return config;
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
  Result<daemon::Input> input = daemon::open_replay(dataset.files, config);
  if (!input) return input.error();
  if (input->T_camera_lidar)
    run.T_camera_base = *input->T_camera_lidar * daemon::to_transform(config.lidar.extrinsic).inverse();
  std::string tum;
  Progress progress(dataset.name, kProgressParts);
  daemon::PipelineOptions options;
  options.clock = clock;
  options.observer = [&](const core::Scan& scan, const core::OdometryResult& result,
                         const core::Odometry& odometry) {
    tum += daemon::tum_line(daemon::make_pose_record(result, scan));
    run.results.push_back(result);
    progress.update(done_parts(dataset.truth, run.results));
    if (observer) observer(scan, result, odometry);
  };
  auto pipeline = daemon::Pipeline::create(config, std::move(input).value(), options, nullptr);
  if (!pipeline) return pipeline.error();
  const auto started = (*pipeline)->start();
  if (!started) return started.error();
  while (!(*pipeline)->finished()) {
    (*pipeline)->output_event().wait(kPoll);
    while ((*pipeline)->poses().try_pop()) {
    }
  }
  (*pipeline)->join();
  if (run.results.size() < 2)
    return Error{dataset.name + ": has fewer than two scans to register - give a longer recording"};
  run.scans_with_imu = (*pipeline)->counters().scans_with_imu.load();
  run.peak_resident_bytes = peak_resident();
  std::vector<core::SE3> poses;
  for (const core::OdometryResult& result : run.results) poses.push_back(result.T_odom_base);
  run.trajectory = make_trajectory(dataset, run, poses);
  run.sha256 = daemon::sha256(tum);
  return run;
}

}  // namespace nilio::tools::bench
