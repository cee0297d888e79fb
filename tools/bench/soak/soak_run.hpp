#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/se3.hpp"
#include "nilio/core/time.hpp"

#include "tools/bench/common/sensor_drive.hpp"
#include "tools/bench/odometry/run_figures.hpp"
#include "tools/common/line_fit.hpp"
#include "tools/common/stop_signals.hpp"

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace nilio::tools {

struct SoakConfig {
  /// Of recorded time.
  core::Duration length = core::Duration::from_seconds(3600.0);
  /// From the beginning; memory is judged after it.
  core::Duration warm_up = core::Duration::from_seconds(600.0);
  /// The vehicle stands: how far poses go from where it is is measured.
  bool standing = false;
  std::vector<std::string> overrides;
  std::uint32_t domain = 0;
};

/// Memory of one process, sampled at every second of recorded time.
struct MemorySeries {
  std::string name;
  std::vector<double> minutes;  ///< of recorded time since the beginning
  std::vector<double> kib;      ///< anonymous, that is allocated by the process
  /// After the warm-up.
  LineFit fit;
};

struct SoakResult {
  MemorySeries pipeline;
  /// Nothing where nilio-publisher is not beside this program; `notes` then says so.
  std::optional<MemorySeries> publisher;
  std::uint64_t scans = 0;
  std::uint64_t poses = 0;
  std::array<std::uint64_t, 4> states{};  ///< poses by core::TrackingState
  std::uint64_t scans_with_imu = 0;
  /// In the histogram of each latency stage, which all poses belong to.
  NamedCounts recorded;
  std::uint32_t map_voxels = 0;
  std::uint64_t packets_dropped = 0;
  std::uint64_t publisher_dropped = 0;
  std::uint64_t publisher_restarts = 0;
  double recorded_minutes = 0.0;
  double wall_seconds = 0.0;
  std::size_t laps = 0;
  /// Standing: the farthest pose, and the farthest mean of a minute, from the mean of the first minute.
  double farthest_pose_m = 0.0;
  double farthest_minute_m = 0.0;
  std::vector<std::string> notes;
};

/// niliod's pipeline in this process and its publisher beside it, as fast as they go, over the drives in a
/// loop.
core::Result<SoakResult> run_soak(std::span<const SensorDrive> drives, const SoakConfig& config,
                                  StopSignals& signals);

/// How far positions go from the mean of their first minute. One thread.
class StandingDrift {
 public:
  void add(core::Time stamp, const core::Vector3& position);
  /// 0 before the first minute is over.
  [[nodiscard]] double farthest_pose_m() const { return farthest_m_; }
  /// Of the means of whole minutes.
  [[nodiscard]] double farthest_minute_m() const { return farthest_minute_m_; }

 private:
  void end_minute();

  std::optional<core::Time> begin_;
  std::int64_t minute_ = 0;
  core::Vector3 sum_ = core::Vector3::Zero();
  std::size_t count_ = 0;
  /// What is not compared yet, as the mean is not known.
  std::vector<core::Vector3> first_minute_;
  std::optional<core::Vector3> mean_;
  double farthest_m_ = 0.0;
  double farthest_minute_m_ = 0.0;
};

}  // namespace nilio::tools
