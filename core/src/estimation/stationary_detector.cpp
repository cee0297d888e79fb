#include "core/src/estimation/stationary_detector.hpp"

#include <cmath>

namespace nilio::core {

namespace {

constexpr std::size_t kMinSamples = 5;
// An idling engine's vibration of 0.1 m/s^2 on each of three axes, and noise; a recorded car at 8 to 20 m/s
// has 0.34 or more in every window.
constexpr double kMaxForceDeviation = 0.2;
constexpr double kMaxRateDeviation = 0.01;
// Two standard deviations of a deviation from 40 samples of three axes.
constexpr double kQuietMargin = 1.13;
constexpr int kMinFirstScans = 5;
// A departure changes the mean specific force long before the scans show it.
constexpr double kMaxForceChange = 0.05;
// Cosine of the steepest road: gravity farther from base_link's z means a wrong extrinsic.
constexpr double kMinUprightness = 0.9;

}  // namespace

bool is_gravity_plausible(const Vector3& force) {
  const double size = force.norm();
  return std::abs(size - kGravity) <= kGravityTolerance && force.z() >= kMinUprightness * size;
}

bool StationaryDetector::is_quiet(const ImuStatistics& imu) const {
  // Constant values indicate a fault, not a stationary vehicle.
  if (imu.count < kMinSamples || imu.acceleration_deviation <= 0.0) return false;
  if (!is_gravity_plausible(imu.mean_acceleration)) return false;
  if (is_stationary() && (imu.mean_acceleration - mean_force_).norm() > kMaxForceChange) return false;
  if (is_first_)
    return imu.acceleration_deviation <= kMaxForceDeviation &&
           imu.angular_velocity_deviation <= kMaxRateDeviation;
  return first_scans_ >= kMinFirstScans && imu.acceleration_deviation <= kQuietMargin * force_deviation_ &&
         imu.angular_velocity_deviation <= kQuietMargin * rate_deviation_;
}

bool StationaryDetector::observe(const ImuStatistics& imu, bool may_be_stationary) {
  if (!is_quiet(imu) || !(is_stationary() || may_be_stationary)) {
    end();
    return false;
  }
  if (scans_ == 0) mean_force_.setZero();
  ++scans_;
  mean_force_ += (imu.mean_acceleration - mean_force_) / scans_;
  if (is_first_) {
    first_scans_ = scans_;
    force_deviation_ += (imu.acceleration_deviation - force_deviation_) / scans_;
    rate_deviation_ += (imu.angular_velocity_deviation - rate_deviation_) / scans_;
  }
  return true;
}

void StationaryDetector::end() {
  is_first_ = false;
  scans_ = 0;
}

void StationaryDetector::contradict() {
  end();
  first_scans_ = 0;
}

}  // namespace nilio::core
