#include "core/src/estimation/pose_slew_limiter.hpp"

#include <algorithm>

namespace nilio::core {

namespace {

void work_off(Vector3& left, double max_slew, Duration settle, double seconds) {
  const double length = left.norm();
  if (length <= 0.0 || seconds <= 0.0) return;
  const double slew = settle.ns > 0 ? std::min(max_slew, length / settle.seconds()) : max_slew;
  left *= std::max(0.0, 1.0 - slew * seconds / length);
}

}  // namespace

PoseCorrection PoseSlewLimiter::correct(const SE3& before, const SE3& after) {
  translation_ += before.translation - after.translation;
  rotation_ = so3_log(so3_exp(rotation_) * before.rotation * after.rotation.conjugate());
  PoseCorrection correction{translation_.norm(), rotation_.norm(), false};
  // Negated so that NaN jumps, too.
  if (correction.distance_m <= limits_.jump_m && correction.angle_rad <= limits_.jump_rad) return correction;
  translation_.setZero();
  rotation_.setZero();
  ++jumps_;
  correction.jumped = true;
  return correction;
}

SE3 PoseSlewLimiter::smooth(const SE3& propagated, Duration since) {
  work_off(translation_, limits_.max_slew_m_s, limits_.settle, since.seconds());
  work_off(rotation_, limits_.max_slew_rad_s, limits_.settle, since.seconds());
  return {(so3_exp(rotation_) * propagated.rotation).normalized(), propagated.translation + translation_};
}

}  // namespace nilio::core
