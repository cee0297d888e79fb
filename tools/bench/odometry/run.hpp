#pragma once

#include "nilio/core/odometry.hpp"
#include "nilio/core/result.hpp"

#include "daemon/config/config.hpp"
#include "daemon/input/replay_files.hpp"
#include "daemon/odometry/odometry_loop.hpp"
#include "tools/common/trajectory.hpp"

#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace nilio::tools::bench {

/// A drive with its truth: the folder of a recording or a KITTI odometry sequence.
struct BenchDataset {
  std::string name;  ///< last part of the folder
  daemon::ReplayFiles files;
  Trajectory truth;
};

/// Opens FOLDER, with the truth in truth.tum or poses.txt in it, or FOLDER:TRUTH.
core::Result<BenchDataset> open_bench_dataset(const std::string& argument);

/// Configuration of niliod for the data set, with `overrides` ("key=value").
core::Result<daemon::Config> bench_config(const BenchDataset& dataset,
                                          const std::vector<std::string>& overrides);

struct BenchRun {
  /// In the truth's format and, for KITTI, in the camera's frame.
  Trajectory trajectory;
  /// Extrinsic of the camera for KITTI sequences, whose poses are those of the camera; identity otherwise.
  core::SE3 T_camera_base;
  std::string sha256;  ///< of trajectory.tum as niliod writes it
  /// One per scan; stage_ns in the clock of the run.
  std::vector<core::OdometryResult> results;
  std::uint64_t scans_with_imu = 0;
  /// Maximum resident memory during the run, and the resident memory before it, bytes; 0 where the kernel
  /// does not report it.
  std::uint64_t peak_resident_bytes = 0;
  std::uint64_t resident_before_bytes = 0;
};

/// Converts poses of base_link, one per scan of the run, to the format and frame of the data set's truth.
Trajectory make_trajectory(const BenchDataset& dataset, const BenchRun& run,
                           std::span<const core::SE3> poses);

/// Replays the data set through niliod's pipeline as fast as possible. `observer`, which may be empty, is
/// called by the odometry thread.
core::Result<BenchRun> run_odometry(const BenchDataset& dataset, const daemon::Config& config,
                                    core::Odometry::ClockFunction clock,
                                    const daemon::ScanObserver& observer);

}  // namespace nilio::tools::bench
