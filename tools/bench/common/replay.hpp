#pragma once

#include "nilio/core/odometry.hpp"
#include "nilio/core/result.hpp"
#include "nilio/core/se3.hpp"

#include "daemon/config/config.hpp"
#include "daemon/input/replay_files.hpp"
#include "daemon/odometry/odometry_loop.hpp"

#include <atomic>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace nilio::tools::bench {

/// Results of one replay through niliod's pipeline in this process.
struct Replay {
  std::vector<core::OdometryResult> results;  ///< one per scan
  std::string tum;                            ///< trajectory.tum as niliod writes it
  /// Set for data sets that state their poses in a camera frame.
  std::optional<core::SE3> T_camera_lidar;
  core::SE3 T_base_lidar;
  std::uint64_t scans_with_imu = 0;
};

/// Configuration of niliod for a recording, with `overrides` ("key=value").
core::Result<daemon::Config> recording_config(const daemon::ReplayFiles& files,
                                              const std::vector<std::string>& overrides);

/// Replays as fast as possible: the same bits as `niliod --replay`. `clock` stamps the stages; `observer`,
/// which may be empty, is called by the odometry thread. `stop`, which may be null, ends it early, with the
/// scans so far. Several replays may run at the same time.
core::Result<Replay> replay(const daemon::ReplayFiles& files, const daemon::Config& config,
                            core::Odometry::ClockFunction clock, const daemon::ScanObserver& observer,
                            const std::atomic<bool>* stop = nullptr);

}  // namespace nilio::tools::bench
