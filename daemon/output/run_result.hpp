#pragma once

#include "nilio/core/result.hpp"

#include "daemon/config/config.hpp"
#include "daemon/exit_status.hpp"
#include "daemon/input/replay_files.hpp"
#include "daemon/output/sha256.hpp"
#include "ipc/odometry_resets.hpp"
#include "ipc/records.hpp"

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

namespace nilio::daemon {

/// How a run ended: exit status and, unless it is kDone, one line why.
struct RunResult {
  ExitStatus exit_status = kDone;
  std::string problem;
};

/// Sums over the poses of a run. One thread.
class RunTotals {
 public:
  /// More lost poses than this share are a bad result.
  static constexpr double kMaxLostShare = 0.05;

  /// Returns the discontinuity at this pose.
  ipc::OdometryReset add(const ipc::PoseRecord& record);
  /// Exit status of a replay that has processed its whole recording.
  [[nodiscard]] RunResult verdict() const;
  /// {"poses", "states", "resets", "path_length_m", "duration_s", "time_source", "trajectory_sha256"}.
  [[nodiscard]] nlohmann::json json() const;

  [[nodiscard]] std::uint64_t poses() const { return poses_; }
  [[nodiscard]] std::uint64_t count(ipc::TrackingState state) const {
    return states_[static_cast<std::size_t>(state)];
  }
  [[nodiscard]] std::uint64_t count(ipc::OdometryReset reset) const {
    return resets_[static_cast<std::size_t>(reset)];
  }
  [[nodiscard]] double path_length_m() const { return path_length_m_; }
  [[nodiscard]] const ipc::OdometryResetDetector& resets() const { return detector_; }
  /// The newest pose.
  [[nodiscard]] const std::optional<ipc::PoseRecord>& last() const { return last_; }

 private:
  std::uint64_t poses_ = 0;
  std::array<std::uint64_t, 4> states_{};
  std::array<std::uint64_t, ipc::kOdometryResets> resets_{};
  ipc::OdometryResetDetector detector_;
  double path_length_m_ = 0.0;
  std::int64_t first_stamp_ns_ = 0;
  std::optional<ipc::PoseRecord> last_;
  Sha256 trajectory_;  ///< of trajectory.tum
};

/// Files that a replay was made from with size and SHA-256: recording, DBC, calibrations, decision log. All
/// scans of a KITTI sequence are one entry: its files in the order of their names.
core::Result<nlohmann::json> describe_inputs(const ReplayFiles& files, const Config& config,
                                             const std::string& decisions_file);

/// {"versions", "configuration_hash", "cpu_s", "peak_memory_bytes"} of this process and the ended
/// nilio-publisher.
nlohmann::json describe_process(const Config& config);

}  // namespace nilio::daemon
