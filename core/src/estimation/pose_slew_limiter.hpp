#pragma once

#include "nilio/core/se3.hpp"
#include "nilio/core/time.hpp"

#include <cstdint>

namespace nilio::core {

/// Limits on how a correction enters the published pose.
struct PoseSlewLimits {
  double max_slew_m_s = 1.0;    ///< maximum change of the published speed
  double max_slew_rad_s = 0.2;  ///< maximum change of the published angular rate
  /// Time constant with which a correction decays, within the limits.
  Duration settle = Duration::from_milliseconds(100.0);
  /// Above either of these the published pose jumps at once.
  double jump_m = 1.0;
  double jump_rad = 0.1;
};

/// Outcome of a correction.
struct PoseCorrection {
  double distance_m = 0.0;  ///< between the published pose and the corrected one
  double angle_rad = 0.0;
  bool jumped = false;  ///< the next pose is the corrected one; else it is approached
};

/// Keeps a published pose from jumping when the state that it is propagated from is corrected: the residual
/// correction decays. Between two published poses it changes by at most the limits times their difference in
/// time, which bounds the error of the published motion. Not thread-safe.
class PoseSlewLimiter {
 public:
  explicit PoseSlewLimiter(const PoseSlewLimits& limits) : limits_(limits) {}

  /// The propagated pose of one instant changed from `before` to `after`.
  PoseCorrection correct(const SE3& before, const SE3& after);
  /// The pose to publish for the propagated one, `since` after the last call.
  SE3 smooth(const SE3& propagated, Duration since);

  /// Residual correction: translation in odom, rotation vector in odom axes.
  [[nodiscard]] const Vector3& translation_left() const { return translation_; }
  [[nodiscard]] const Vector3& rotation_left() const { return rotation_; }
  [[nodiscard]] std::uint64_t jumps() const { return jumps_; }

 private:
  PoseSlewLimits limits_;
  Vector3 translation_ = Vector3::Zero();
  Vector3 rotation_ = Vector3::Zero();
  std::uint64_t jumps_ = 0;
};

}  // namespace nilio::core
