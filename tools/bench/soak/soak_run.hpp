#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/se3.hpp"
#include "nilio/core/time.hpp"

#include "tools/bench/common/niliod_run.hpp"
#include "tools/bench/common/sensor_drive.hpp"
#include "tools/common/statistics.hpp"
#include "tools/common/system.hpp"

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace nilio::tools::bench {

inline constexpr double kMinuteS = 60.0;

struct SoakConfig {
  /// Recorded time to play.
  core::Duration length = core::Duration::from_seconds(3600.0);
  /// Part of it before the memory is checked.
  core::Duration warm_up = core::Duration::from_seconds(600.0);
  /// The vehicle is at rest: measures the drift of its position.
  bool stationary = false;
  std::vector<std::string> overrides;
  std::uint32_t domain = 0;
};

/// Memory of one process, sampled at every second of recorded time.
struct MemorySeries {
  std::string name;
  std::vector<double> minutes;  ///< recorded time since the beginning
  std::vector<double> kib;      ///< anonymous memory, allocated by the process
  LineFit fit;                  ///< of the samples after the warm-up
};

struct SoakResult {
  MemorySeries pipeline;
  /// Empty where nilio-publisher is not beside this program; `notes` reports it.
  std::optional<MemorySeries> publisher;
  std::uint64_t scans = 0;
  std::uint64_t poses = 0;
  std::array<std::uint64_t, 4> states{};  ///< poses by core::TrackingState
  std::uint64_t scans_with_imu = 0;
  /// Poses in the histogram of each latency stage.
  NamedCounts recorded;
  std::uint32_t map_voxels = 0;
  std::uint64_t packets_dropped = 0;
  std::uint64_t publisher_dropped = 0;
  std::uint64_t publisher_restarts = 0;
  double recorded_minutes = 0.0;
  double wall_seconds = 0.0;
  std::size_t laps = 0;
  /// Stationary: maximum distance of a pose, and of the mean of a minute, from the mean of the first minute.
  double max_pose_m = 0.0;
  double max_minute_m = 0.0;
  std::vector<std::string> notes;
};

/// Runs niliod's pipeline in this process and nilio-publisher beside it, as fast as possible, over the drives
/// in a loop.
core::Result<SoakResult> run_soak(std::span<const SensorDrive> drives, const SoakConfig& config,
                                  StopSignals& signals);

/// Distance of positions from the mean of their first minute. Not thread-safe.
class StationaryDrift {
 public:
  void add(core::Time stamp, const core::Vector3& position);
  /// Maximum distance; 0 before the end of the first minute.
  [[nodiscard]] double max_pose_m() const { return max_pose_m_; }
  /// Maximum distance of the means of whole minutes.
  [[nodiscard]] double max_minute_m() const { return max_minute_m_; }

 private:
  void end_minute();

  std::optional<core::Time> begin_;
  std::int64_t minute_ = 0;
  core::Vector3 sum_ = core::Vector3::Zero();
  std::size_t count_ = 0;
  /// Positions to be compared once the mean is known.
  std::vector<core::Vector3> first_minute_;
  std::optional<core::Vector3> mean_;
  double max_pose_m_ = 0.0;
  double max_minute_m_ = 0.0;
};

}  // namespace nilio::tools::bench
