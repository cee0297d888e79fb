#pragma once

#include "nilio/core/se3.hpp"

#include <optional>

namespace nilio::core {

/// A time step; acceleration in m/s^2 where the accelerometer measures it, otherwise the trend holds.
struct TwistStep {
  double seconds = 0.0;
  std::optional<Vector3> acceleration;
  /// Gain of the velocity for an error of the mean velocity, 0 to 1 along each axis, where the accelerometer
  /// is used.
  Vector3 velocity_gain = Vector3::Zero();
};

/// Twist of base_link in its own axes (linear m/s, angular rad/s) and its trend: an alpha-beta filter for
/// each component (Kalata 1984). The gain rises while innovations keep their sign (lag) and falls while they
/// alternate (noise); the first scan of a corner, beyond the noise of its rotation, has a high gain at once,
/// because it is deskewed with the result. The gain is bounded by Kalata's relation for the observability of
/// the axis, and trends of unobserved axes decay. Where the accelerometer is used, its acceleration replaces
/// the trend and MotionFilter gives the gain.
class TwistFilter {
 public:
  /// Resets to a given twist.
  void reset(const Vector6& twist);
  /// Twist at the midpoint of the last sweep.
  [[nodiscard]] const Vector6& twist() const { return twist_; }
  /// Twist at the end of the step. Neither trends nor sway are extrapolated over a gap.
  [[nodiscard]] Vector6 predict(const TwistStep& step) const;
  /// Twist after the step, given its mean and its observability, 0 to 1 along each axis.
  [[nodiscard]] Vector6 correct(const Vector6& mean, const Vector6& share, const TwistStep& step) const;
  /// Updates to it.
  void update(const Vector6& mean, const Vector6& share, const TwistStep& step);
  /// Propagates without a measurement: sway ends, the rest stays or follows the accelerometer.
  void hold(const TwistStep& step);
  /// Zero-velocity update of the linear part; rotation is unaffected.
  void stand();

 private:
  struct Gains {
    Vector6 twist;
    Vector6 slope;
  };
  [[nodiscard]] Vector6 innovation(const Vector6& mean, const TwistStep& step) const {
    return mean - predict({0.5 * step.seconds, step.acceleration});
  }
  [[nodiscard]] double gain_of(int i, double innovation) const;
  [[nodiscard]] Gains gains(const Vector6& error, const Vector6& share, const TwistStep& step) const;

  Vector6 twist_ = Vector6::Zero();
  Vector6 slope_ = Vector6::Zero();
  Vector6 gain_ = Vector6::Constant(0.5);
  Vector6 square_ = Vector6::Zero();  ///< mean square of innovations
  Vector6 last_ = Vector6::Zero();    ///< innovation
};

}  // namespace nilio::core
