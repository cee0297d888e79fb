#include "core/src/estimation/standing_start.hpp"

#include "core/src/estimation/gravity.hpp"

#include <cmath>

namespace nilio::core {

namespace {

constexpr std::size_t kLeastSamples = 5;
// Above an idling engine's vibration, below a driving vehicle's; over all three axes.
constexpr double kMostForceDeviation = 0.1;
constexpr double kMostRateDeviation = 0.01;
// A departure changes the mean specific force long before the scans show it.
constexpr double kMostForceChange = 0.05;
constexpr double kMostMetres = 0.1;
constexpr double kGravityTolerance = 0.5;
// Cosine of the steepest road: gravity farther from base_link's z means a wrong extrinsic.
constexpr double kLeastUprightness = 0.9;

}  // namespace

bool shows_gravity(const Vector3& force) {
  const double size = force.norm();
  return std::abs(size - kGravity) <= kGravityTolerance && force.z() >= kLeastUprightness * size;
}

bool StandingStart::goes_on(const ImuStatistics& felt, const Vector3& place) const {
  // Constant values indicate a fault, not a stationary vehicle.
  if (felt.count < kLeastSamples || felt.acceleration_deviation <= 0.0) return false;
  if (felt.acceleration_deviation > kMostForceDeviation) return false;
  if (felt.angular_velocity_deviation > kMostRateDeviation || !shows_gravity(felt.mean_acceleration))
    return false;
  if (scans_ > 0 && (felt.mean_acceleration - mean_force_).norm() > kMostForceChange) return false;
  return scans_ < 2 || (place - first_place_).norm() < kMostMetres;
}

bool StandingStart::observe(const ImuStatistics& felt, const Vector3& place) {
  is_over_ = is_over_ || !goes_on(felt, place);
  if (is_over_) return false;
  // The initial velocity search moves the second scan.
  if (scans_ < 2) first_place_ = place;
  ++scans_;
  mean_force_ += (felt.mean_acceleration - mean_force_) / scans_;
  return true;
}

}  // namespace nilio::core
