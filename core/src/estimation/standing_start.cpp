#include "core/src/estimation/standing_start.hpp"

#include "core/src/estimation/gravity.hpp"

#include <cmath>

namespace nilio::core {

namespace {

constexpr std::size_t kLeastSamples = 5;
// Over all three axes: what idles shakes less, what drives shakes more.
constexpr double kMostForceDeviation = 0.1;
constexpr double kMostRateDeviation = 0.01;
// Setting off is felt as a change of the mean, long before it can be seen.
constexpr double kMostForceChange = 0.05;
constexpr double kMostMetres = 0.1;
constexpr double kGravityTolerance = 0.5;
// No road is steeper: gravity farther from base_link's z is a wrong extrinsic, not a slope.
constexpr double kLeastUprightness = 0.9;

}  // namespace

bool shows_gravity(const Vector3& force) {
  const double size = force.norm();
  return std::abs(size - kGravity) <= kGravityTolerance && force.z() >= kLeastUprightness * size;
}

bool StandingStart::goes_on(const ImuStatistics& felt, const Vector3& place) const {
  // Values that never change are no sign of calm but of a fault.
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
  // The search for a start puts the second scan elsewhere.
  if (scans_ < 2) first_place_ = place;
  ++scans_;
  mean_force_ += (felt.mean_acceleration - mean_force_) / scans_;
  return true;
}

}  // namespace nilio::core
