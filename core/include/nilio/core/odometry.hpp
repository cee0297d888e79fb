#pragma once

#include "nilio/core/imu_health.hpp"
#include "nilio/core/odometry_config.hpp"
#include "nilio/core/odometry_result.hpp"
#include "nilio/core/scan.hpp"

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include <Eigen/Core>

namespace nilio::core {

/// NI-LIO's odometry: filter, deskew with the IMU, NDT coarse and point-to-plane ICP fine until the motion
/// settles, map update. Not thread-safe: one thread owns it. No I/O and no clock but the injected one, which
/// serves stage_ns and the wall-clock budget. Hosts with deadlines, logs of decisions or real-time threads
/// use OdometryRuntime beside it.
class Odometry {
 public:
  using ClockFunction = std::int64_t (*)();

  explicit Odometry(const OdometryConfig& config, ClockFunction clock = nullptr);
  Odometry(Odometry&&) noexcept;
  Odometry& operator=(Odometry&&) noexcept;
  Odometry(const Odometry&) = delete;
  Odometry& operator=(const Odometry&) = delete;
  ~Odometry();

  /// Adds a sample, in order of time and before the scans that it covers. Returns false for a refused sample
  /// (stamp goes back, not finite).
  bool add_imu(const ImuSample& sample);
  /// Registers a scan; scans in order of time. Always returns a pose: `predicted` and `state` tell how it was
  /// obtained.
  OdometryResult register_scan(const Scan& scan);
  /// Results of the IMU monitor after the last scan; OdometryResult::imu_used follows from them.
  [[nodiscard]] const ImuHealth& imu_health() const;

  /// Correction of a beam of the LiDAR so far; `ring` is less than kMaxCalibratedBeams. Zero for
  /// a beam that has not been seen, and without OdometryConfig::calibrate_beams.
  [[nodiscard]] BeamCorrection beam_correction(std::size_t ring) const;

  /// Inserts the last registered scan into the map and completes its `result` (kMapped, map_voxels,
  /// map_refused). Optional: the next register_scan() does it otherwise. Separate, so that a pose need not
  /// wait for the map.
  void update_map(OdometryResult& result);
  /// The last registered scan, deskewed and filtered, in base_link at its end. Valid after update_map().
  [[nodiscard]] const std::vector<Eigen::Vector3f>& deskewed_points() const;
  /// Reflectivity of deskewed_points()[index] as the sensor reports it.
  [[nodiscard]] float deskewed_intensity(std::size_t index) const;

 private:
  friend class OdometryRuntime;
  struct State;
  OdometryResult register_within_budget(const Scan& scan);
  std::unique_ptr<State> state_;
};

}  // namespace nilio::core
