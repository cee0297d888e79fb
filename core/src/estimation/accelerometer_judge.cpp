#include "core/src/estimation/accelerometer_judge.hpp"

#include "core/src/estimation/gravity.hpp"

#include <algorithm>
#include <cmath>

namespace nilio::core {

namespace {

constexpr int kLeastSpans = 5;
// Memory of the velocity noise, in spans.
constexpr int kMostSpans = 50;
constexpr double kLeastNoise = 0.01;
// An initial acceleration of up to 1 m/s^2 is absorbed into gravity; later a bias of 0.05 m/s^2 turns with
// the vehicle within seconds.
constexpr double kFirstVariance = 1.0;
constexpr double kVariancePerSecond = 0.002;
// Prior log-likelihood ratio: an accelerometer that measures gravity is probably sound.
constexpr double kFirstRatio = 2.0;
constexpr double kMostRatio = 20.0;
constexpr double kGravityTolerance = 1.0;

}  // namespace

void AccelerometerJudge::learn_noise(double square) {
  noise_square_ += (square - noise_square_) / spans_;
  noise_square_ = std::max(noise_square_, kLeastNoise * kLeastNoise);
}

void AccelerometerJudge::learn(const Evidence& evidence) {
  if (evidence.seconds <= 0.0 || !evidence.felt.allFinite() || !evidence.measured.allFinite()) return;
  if (spans_ == 0) {
    support_ = evidence.felt / evidence.seconds;
    support_variance_ = kFirstVariance;
    log_likelihood_ratio_ = kFirstRatio;
  }
  spans_ = std::min(spans_ + 1, kMostSpans);
  const Vector3 innovation =
      evidence.seen * ((evidence.felt - evidence.measured) / evidence.seconds - support_);
  const double felt_square = (innovation * evidence.seconds).squaredNorm();
  const double held_square = evidence.held_error * evidence.held_error;
  // Outlier: if both residuals are large, the sample does not change the ratio.
  const double least_square = std::min(felt_square, held_square) / 3.0;
  learn_noise(least_square);
  const double noise_square = std::max(noise_square_, least_square);
  if (!evidence.only_weigh) support_variance_ += kVariancePerSecond * evidence.seconds;
  // The uncertainty of gravity and bias is not held against the accelerometer.
  const double squared_s = evidence.seconds * evidence.seconds;
  const double uncertain_square = noise_square + support_variance_ * squared_s;
  const double change = (held_square - felt_square) / (2.0 * uncertain_square);
  log_likelihood_ratio_ = std::clamp(log_likelihood_ratio_ + change, -kMostRatio, kMostRatio);
  if (evidence.only_weigh) return;
  const double gain = support_variance_ * squared_s / uncertain_square;
  support_ += gain * innovation;
  support_variance_ *= 1.0 - gain;
}

void AccelerometerJudge::know_support(const Vector3& support, double variance) {
  if (spans_ == 0) log_likelihood_ratio_ = kFirstRatio;
  spans_ = std::max(spans_, kLeastSpans);
  support_ = support;
  support_variance_ = variance;
}

bool AccelerometerJudge::helps() const {
  return spans_ >= kLeastSpans && log_likelihood_ratio_ > 0.0 &&
         std::abs(support_.norm() - kGravity) < kGravityTolerance;
}

}  // namespace nilio::core
