#pragma once

#include "nilio/core/se3.hpp"
#include "nilio/core/time.hpp"

#include "core/src/estimation/imu_buffer.hpp"

namespace nilio::core {

/// Specific force at rest, m/s^2.
inline constexpr double kGravity = 9.81;
/// Largest error of a sound accelerometer's gravity, m/s^2: data sheets of consumer sensors allow 80 mg of
/// offset and 3 % of scale, 0.84 together as independent errors. Beyond, unit or scale are wrong.
inline constexpr double kGravityTolerance = 1.0;

/// Whether the specific force in axes of base_link, m/s^2, is gravity on a road of any slope; if not, unit or
/// axes are wrong.
bool is_gravity_plausible(const Vector3& force);

/// Detects from the IMU alone that the vehicle is stationary, which scans cannot where most of the scene
/// moves. At the start the mean specific force initialises gravity and accelerometer bias, and the deviations
/// show how quiet this vehicle is then: later it is stationary where it is as quiet. Not thread-safe.
class StationaryDetector {
 public:
  /// Call once a scan with the samples of the last `kWindow`. `may_be_stationary`: the velocity is not known
  /// to differ from zero. Returns whether the vehicle is stationary.
  bool observe(const ImuStatistics& imu, bool may_be_stationary);
  /// The vehicle moves, as seen elsewhere.
  void end();
  /// The scans showed that a vehicle as quiet as this one moves: it is never again taken to be stationary.
  void contradict();
  [[nodiscard]] bool is_stationary() const { return scans_ > 0; }
  /// Stationary since the start.
  [[nodiscard]] bool is_first() const { return is_first_; }
  /// The scan is the first of this stationary_detector.
  [[nodiscard]] bool has_begun() const { return scans_ == 1; }
  /// Mean specific force while stationary, m/s^2, in axes of base_link.
  [[nodiscard]] const Vector3& mean_force() const { return mean_force_; }

  static constexpr Duration kWindow = Duration::from_milliseconds(200.0);

 private:
  [[nodiscard]] bool is_quiet(const ImuStatistics& imu) const;

  bool is_first_ = true;
  int scans_ = 0;        ///< of this phase
  int first_scans_ = 0;  ///< of that since the start
  Vector3 mean_force_ = Vector3::Zero();
  double force_deviation_ = 0.0;  ///< means of that since the start, m/s^2 and rad/s
  double rate_deviation_ = 0.0;
};

}  // namespace nilio::core
