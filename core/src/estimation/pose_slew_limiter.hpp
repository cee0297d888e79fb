#pragma once

#include "nilio/core/se3.hpp"
#include "nilio/core/time.hpp"

#include <cstdint>

namespace nilio::core {

/// How a correction of a pose that is being published is worked off.
struct PoseSlewLimits {
  double max_slew_m_s = 1.0;    ///< added to, or taken from, the speed of the published position
  double max_slew_rad_s = 0.2;  ///< the same of the rotation
  /// A correction fades with this time constant where the limits allow it.
  Duration settle = Duration::from_milliseconds(100.0);
  /// Above either of these the published pose jumps at once.
  double jump_m = 1.0;
  double jump_rad = 0.1;
};

/// What became of a correction.
struct PoseCorrection {
  double distance_m = 0.0;  ///< between the published pose and the corrected one
  double angle_rad = 0.0;
  bool jumped = false;  ///< the next pose is the corrected one; else it is approached
};

/// Keeps a published pose from jumping when what it is propagated from is corrected: the difference is kept
/// and worked off. Between two published poses it changes by no more than the limits times their distance in
/// time, so that is how far the published motion can be from the propagated one. Not thread-safe.
class PoseSmoother {
 public:
  explicit PoseSmoother(const PoseSlewLimits& limits) : limits_(limits) {}

  /// The propagated pose of one and the same instant was `before` and is `after` now.
  PoseCorrection correct(const SE3& before, const SE3& after);
  /// The pose to publish for the propagated one, `since` after the last call.
  SE3 smooth(const SE3& propagated, Duration since);

  /// What is left to be worked off: translation in odom, rotation vector in odom axes.
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
