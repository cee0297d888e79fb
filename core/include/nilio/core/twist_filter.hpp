#pragma once

#include "nilio/core/se3.hpp"

#include <optional>

namespace nilio::core {

/// A step in time, and how the linear velocity changes meanwhile, m/s^2, where that is felt; it changes as it
/// did, else.
struct TwistStep {
  double seconds = 0.0;
  std::optional<Vector3> acceleration;
  /// Part of a mean velocity's error by which a felt velocity is corrected, 0 to 1 along each axis.
  Vector3 felt_gain = Vector3::Zero();
};

/// Twist of base_link in its own axes (linear m/s, then angular rad/s) and how it changes, from noisy
/// measurements: an alpha-beta filter for each component (Kalata 1984), whose gain follows the drive. Where
/// innovations keep their sign the filter lags, and its gain rises; where they alternate it follows noise,
/// and its gain falls. Where a registration followed the prediction instead of the scan, it says nothing new:
/// the gain is bounded by what an alpha-beta filter makes of a place that is known to that share, and the
/// change of the twist is forgotten. Where the change is felt, nothing of it is learnt, and the gain is given
/// (FeltMotionFilter).
class TwistFilter {
 public:
  /// Starts anew from a twist that is simply believed.
  void reset(const Vector6& twist);
  /// Twist at the middle of the last sweep.
  [[nodiscard]] const Vector6& twist() const { return twist_; }
  /// Twist at the end of the step. Over a gap neither trends nor sway are extrapolated.
  [[nodiscard]] Vector6 predict(const TwistStep& step) const;
  /// Twist after the step, had its mean over the step been `mean`. `share` of it, 0 to 1 along each axis,
  /// comes from the scan.
  [[nodiscard]] Vector6 correct(const Vector6& mean, const Vector6& share, const TwistStep& step) const;
  /// Goes on to it.
  void learn(const Vector6& mean, const Vector6& share, const TwistStep& step);
  /// Goes on without a measurement: the twist stays as it is but for sway, which ends, and what is felt.
  void hold(const TwistStep& step);
  /// The vehicle is known to stand; how it turns is not.
  void stand();

 private:
  struct Gains {
    Vector6 twist;
    Vector6 slope;
  };
  [[nodiscard]] Vector6 innovation(const Vector6& mean, const TwistStep& step) const {
    return mean - predict({0.5 * step.seconds, step.acceleration});
  }
  [[nodiscard]] Gains gains(const Vector6& share, const TwistStep& step) const;

  Vector6 twist_ = Vector6::Zero();
  Vector6 slope_ = Vector6::Zero();
  Vector6 gain_ = Vector6::Constant(0.5);
  Vector6 square_ = Vector6::Zero();  ///< mean square of innovations
  Vector6 last_ = Vector6::Zero();    ///< innovation
};

}  // namespace nilio::core
