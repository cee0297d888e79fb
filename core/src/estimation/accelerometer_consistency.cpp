#include "core/src/estimation/accelerometer_consistency.hpp"

#include "core/src/estimation/stationary_detector.hpp"

#include <algorithm>
#include <cmath>

namespace nilio::core {

namespace {

constexpr int kMinSpans = 5;
// Memory of the velocity noise, in spans.
constexpr int kMaxSpans = 50;
constexpr double kMinNoise = 0.01;
// An initial acceleration of up to 1 m/s^2 is absorbed into gravity; later a bias of 0.05 m/s^2 turns with
// the vehicle within seconds.
constexpr double kFirstVariance = 1.0;
constexpr double kVariancePerSecond = 0.002;
// Prior log-likelihood ratio: an accelerometer that measures gravity is probably sound.
constexpr double kFirstRatio = 2.0;
constexpr double kMaxRatio = 20.0;
constexpr double kGravityTolerance = 1.0;

}  // namespace

void AccelerometerConsistency::update_noise(double square) {
  noise_square_ += (square - noise_square_) / spans_;
  noise_square_ = std::max(noise_square_, kMinNoise * kMinNoise);
}

void AccelerometerConsistency::update(const Evidence& evidence) {
  if (evidence.seconds <= 0.0 || !evidence.imu_change.allFinite() || !evidence.measured.allFinite()) return;
  if (spans_ == 0) {
    gravity_bias_ = evidence.imu_change / evidence.seconds;
    gravity_bias_variance_ = kFirstVariance;
    log_likelihood_ratio_ = kFirstRatio;
  }
  spans_ = std::min(spans_ + 1, kMaxSpans);
  const Vector3 innovation =
      evidence.seen * ((evidence.imu_change - evidence.measured) / evidence.seconds - gravity_bias_);
  const double imu_square = (innovation * evidence.seconds).squaredNorm();
  const double held_square = evidence.held_error * evidence.held_error;
  // Outlier: if both residuals are large, the sample does not change the ratio.
  const double least_square = std::min(imu_square, held_square) / 3.0;
  update_noise(least_square);
  const double noise_square = std::max(noise_square_, least_square);
  if (!evidence.only_weigh) gravity_bias_variance_ += kVariancePerSecond * evidence.seconds;
  // The uncertainty of gravity and bias is not held against the accelerometer.
  const double squared_s = evidence.seconds * evidence.seconds;
  const double uncertain_square = noise_square + gravity_bias_variance_ * squared_s;
  const double change = (held_square - imu_square) / (2.0 * uncertain_square);
  log_likelihood_ratio_ = std::clamp(log_likelihood_ratio_ + change, -kMaxRatio, kMaxRatio);
  if (evidence.only_weigh) return;
  const double gain = gravity_bias_variance_ * squared_s / uncertain_square;
  gravity_bias_ += gain * innovation;
  gravity_bias_variance_ *= 1.0 - gain;
}

void AccelerometerConsistency::set_gravity_bias(const Vector3& gravity_bias, double variance) {
  if (spans_ == 0) log_likelihood_ratio_ = kFirstRatio;
  spans_ = std::max(spans_, kMinSpans);
  gravity_bias_ = gravity_bias;
  gravity_bias_variance_ = variance;
}

bool AccelerometerConsistency::helps() const {
  return spans_ >= kMinSpans && log_likelihood_ratio_ > 0.0 &&
         std::abs(gravity_bias_.norm() - kGravity) < kGravityTolerance;
}

}  // namespace nilio::core
