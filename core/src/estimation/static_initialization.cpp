#include "core/src/estimation/static_initialization.hpp"

#include <cmath>

namespace nilio::core {

namespace {

constexpr std::size_t kMinSamples = 5;
// An idling engine's vibration of 0.1 m/s^2 on each of three axes, and noise; a driving vehicle has more.
constexpr double kMaxForceDeviation = 0.2;
constexpr double kMaxRateDeviation = 0.01;
// A departure changes the mean specific force long before the scans show it.
constexpr double kMaxForceChange = 0.05;
constexpr double kGravityTolerance = 0.5;
// Cosine of the steepest road: gravity farther from base_link's z means a wrong extrinsic.
constexpr double kMinUprightness = 0.9;

}  // namespace

bool is_gravity_plausible(const Vector3& force) {
  const double size = force.norm();
  return std::abs(size - kGravity) <= kGravityTolerance && force.z() >= kMinUprightness * size;
}

bool StaticInitialization::is_still_stationary(const ImuStatistics& imu) const {
  // Constant values indicate a fault, not a stationary vehicle.
  if (imu.count < kMinSamples || imu.acceleration_deviation <= 0.0) return false;
  if (imu.acceleration_deviation > kMaxForceDeviation) return false;
  if (imu.angular_velocity_deviation > kMaxRateDeviation || !is_gravity_plausible(imu.mean_acceleration))
    return false;
  return scans_ == 0 || (imu.mean_acceleration - mean_force_).norm() <= kMaxForceChange;
}

bool StaticInitialization::observe(const ImuStatistics& imu) {
  has_ended_ = has_ended_ || !is_still_stationary(imu);
  if (has_ended_) return false;
  ++scans_;
  mean_force_ += (imu.mean_acceleration - mean_force_) / scans_;
  return true;
}

}  // namespace nilio::core
