#pragma once

#include "nilio/core/se3.hpp"
#include "nilio/core/time.hpp"

#include "core/src/estimation/imu_buffer.hpp"

namespace nilio::core {

/// Specific force at rest, m/s^2.
inline constexpr double kGravity = 9.81;

/// Whether the specific force in axes of base_link, m/s^2, is gravity on a road of any slope; if not, unit or
/// axes are wrong.
bool is_gravity_plausible(const Vector3& force);

/// Static initialisation: detects from the IMU alone that the vehicle has been stationary since the start,
/// which scans cannot where most of the scene moves. The mean specific force meanwhile initialises gravity and
/// accelerometer bias. Not thread-safe.
class StaticInitialization {
 public:
  /// Call once a scan with the samples of the last `kWindow`. Returns whether the vehicle is still stationary;
  /// ends for good when the IMU measures a change.
  bool observe(const ImuStatistics& imu);
  /// Ends the phase: motion was detected elsewhere.
  void end() { has_ended_ = true; }
  [[nodiscard]] bool is_over() const { return has_ended_; }
  /// Mean specific force while stationary, m/s^2, in axes of base_link.
  [[nodiscard]] const Vector3& mean_force() const { return mean_force_; }

  static constexpr Duration kWindow = Duration::from_milliseconds(200.0);

 private:
  [[nodiscard]] bool is_still_stationary(const ImuStatistics& imu) const;

  bool has_ended_ = false;
  int scans_ = 0;
  Vector3 mean_force_ = Vector3::Zero();
};

}  // namespace nilio::core
