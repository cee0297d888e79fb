#pragma once

#include "nilio/core/odometry.hpp"
#include "nilio/core/result.hpp"

#include "daemon/config/config.hpp"
#include "daemon/input/replay_files.hpp"
#include "daemon/odometry/odometry_loop.hpp"
#include "tools/evaluate/trajectory.hpp"

#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace nilio::tools {

/// A drive with its truth: a recording's folder, or a KITTI odometry sequence.
struct BenchDataset {
  std::string name;  ///< last part of the folder
  daemon::ReplayFiles files;
  Trajectory truth;
};

/// `argument` is FOLDER, with the truth in FOLDER/truth.tum or FOLDER/poses.txt, or FOLDER:TRUTH.
core::Result<BenchDataset> open_bench_dataset(const std::string& argument);

/// The configuration that niliod would run the data set with, under `overrides` ("key=value").
core::Result<daemon::Config> bench_config(const BenchDataset& dataset,
                                          const std::vector<std::string>& overrides);

struct BenchRun {
  /// In the truth's format and, for KITTI, in the camera's frame.
  Trajectory trajectory;
  /// Camera in base_link's place for KITTI sequences, whose poses are the camera's; identity otherwise.
  core::SE3 T_camera_base;
  /// Of the file trajectory.tum that niliod would write.
  std::string sha256;
  /// Per scan; stage_ns by the clock that was asked for.
  std::vector<core::OdometryResult> results;
  std::uint64_t scans_with_imu = 0;
  /// Largest resident memory while the run lasted and just before it, bytes; 0 where the kernel does not
  /// tell.
  std::uint64_t peak_resident_bytes = 0;
  std::uint64_t resident_before_bytes = 0;
};

/// `poses` of base_link at the scans of the run in the form that the data set's truth has.
Trajectory make_trajectory(const BenchDataset& dataset, const BenchRun& run,
                           std::span<const core::SE3> poses);

/// Replays the data set through niliod's own pipeline as fast as it goes. `observer`, which may be empty, is
/// called by the odometry thread.
core::Result<BenchRun> run_odometry(const BenchDataset& dataset, const daemon::Config& config,
                                    core::Odometry::ClockFunction clock,
                                    const daemon::ScanObserver& observer);

}  // namespace nilio::tools
