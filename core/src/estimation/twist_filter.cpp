#include "core/src/estimation/twist_filter.hpp"

#include "nilio/core/portable_math.hpp"

#include <algorithm>
#include <cmath>

namespace nilio::core {

namespace {

constexpr double kMinGain = 0.2;
constexpr double kMaxGain = 0.9;
// Step of the gain, and memory of the innovation variance.
constexpr double kGainStep = 0.1;
constexpr double kTwistMemory = 0.9;
// Beyond this many standard deviations an innovation is no noise.
constexpr double kNoiseSigmas = 4.0;
// Trends are extrapolated over two lost scans at most. Roll and pitch rates are body sway with zero mean: no
// trend, and over a longer gap only this much of them continues.
constexpr double kMaxExtrapolationSeconds = 0.25;
constexpr int kRollRate = 3;

}  // namespace

void TwistFilter::reset(const Vector6& twist) {
  twist_ = twist;
  slope_.setZero();
  last_.setZero();
}

Vector6 TwistFilter::predict(const TwistStep& step) const {
  const bool is_gap = step.seconds > kMaxExtrapolationSeconds;
  Vector6 twist = twist_;
  if (is_gap) {
    twist.segment<2>(kRollRate) *= kMaxExtrapolationSeconds / step.seconds;
  } else {
    twist += step.seconds * slope_;
  }
  if (step.acceleration) twist.head<3>() = twist_.head<3>() + step.seconds * *step.acceleration;
  return twist;
}

double TwistFilter::gain_of(int i, double innovation) const {
  const double square = innovation * innovation;
  const double noise = kNoiseSigmas * kNoiseSigmas * square_[i];
  if (i < kRollRate || square <= noise) return gain_[i];
  return std::max(gain_[i], std::min(kMaxGain, 1.0 - noise / square));
}

TwistFilter::Gains TwistFilter::gains(const Vector6& error, const Vector6& share,
                                      const TwistStep& step) const {
  Gains gains;
  for (int i = 0; i < 6; ++i) {
    // Kalata's relation between the gains of velocity and position.
    const double alpha = std::clamp(share[i], 0.01, 1.0);
    const double beta = 2.0 * (2.0 - alpha) - 4.0 * std::sqrt(1.0 - alpha);
    const double gain = std::min(gain_of(i, error[i]), beta / alpha);
    gains.slope[i] = gain * gain / (2.0 - gain);
    // At the end of the interval; the mean belongs to its middle.
    gains.twist[i] = gain + 0.5 * gains.slope[i];
  }
  if (step.acceleration) {
    gains.twist.head<3>() = step.velocity_gain.cwiseMax(0.0).cwiseMin(1.0);
    gains.slope.head<3>().setZero();
  }
  return gains;
}

Vector6 TwistFilter::correct(const Vector6& mean, const Vector6& share, const TwistStep& step) const {
  const Vector6 error = innovation(mean, step);
  return predict(step) + gains(error, share, step).twist.cwiseProduct(error);
}

void TwistFilter::hold(const TwistStep& step) {
  slope_.setZero();
  twist_ = predict(step);
  twist_.segment<2>(kRollRate).setZero();
}

void TwistFilter::stand() {
  twist_.head<3>().setZero();
  slope_.head<3>().setZero();
  last_.head<3>().setZero();
}

void TwistFilter::update(const Vector6& mean, const Vector6& share, const TwistStep& step) {
  const Vector6 error = innovation(mean, step);
  const Gains used = gains(error, share, step);
  twist_ = predict(step) + used.twist.cwiseProduct(error);
  slope_ = share.cwiseProduct(slope_ + used.slope.cwiseProduct(error) / step.seconds);
  slope_.segment<2>(kRollRate).setZero();
  if (step.acceleration) slope_.head<3>().setZero();
  for (int i = 0; i < 6; ++i) {
    const double correlation =
        square_[i] > 0.0 ? std::clamp(error[i] * last_[i] / square_[i], -2.0, 2.0) : 0.0;
    gain_[i] = std::clamp(gain_[i] * portable::exp(kGainStep * correlation), kMinGain, kMaxGain);
  }
  square_ = kTwistMemory * square_ + (1.0 - kTwistMemory) * error.cwiseAbs2();
  last_ = error;
}

}  // namespace nilio::core
