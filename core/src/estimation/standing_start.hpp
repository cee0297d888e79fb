#pragma once

#include "nilio/core/se3.hpp"
#include "nilio/core/time.hpp"

#include "core/src/estimation/imu_buffer.hpp"

namespace nilio::core {

/// Whether this specific force in axes of base_link, m/s^2, is that of gravity on a road, however steep: else
/// unit or axes are wrong.
bool shows_gravity(const Vector3& force);

/// Whether the vehicle has been standing since the odometry began, as the IMU alone tells: where most of what
/// a LiDAR sees begins to move, scans cannot. What is felt meanwhile is the support (AccelerometerJudge), the
/// more exactly the longer. Not thread-safe.
class StandingStart {
 public:
  /// Samples of the last `kWindow` and the place of the last registered scan, m, once a scan. Standing ends,
  /// for good, when anything is felt to change, or when scans have moved the place all the same, as they do
  /// at a walking pace too smooth to feel.
  bool observe(const ImuStatistics& felt, const Vector3& place);
  /// It is known from elsewhere that it moves.
  void end() { is_over_ = true; }
  [[nodiscard]] bool is_over() const { return is_over_; }
  /// Mean specific force while standing, m/s^2, in axes of base_link.
  [[nodiscard]] const Vector3& mean_force() const { return mean_force_; }

  static constexpr Duration kWindow = Duration::from_milliseconds(200.0);

 private:
  [[nodiscard]] bool goes_on(const ImuStatistics& felt, const Vector3& place) const;

  bool is_over_ = false;
  int scans_ = 0;
  Vector3 first_place_ = Vector3::Zero();
  Vector3 mean_force_ = Vector3::Zero();
};

}  // namespace nilio::core
