#include "core/src/estimation/inertial_velocity.hpp"

#include <algorithm>

namespace nilio::core {

ImuIncrement integrate_imu(const TurnRate& rate, Time from, Time to, const Eigen::Quaterniond& rotation) {
  const ImuBuffer& imu = rate.imu;
  ImuIncrement increment;
  increment.rotation = rotation;
  Time time = from;
  for (std::size_t i = imu.lower_bound(from); time < to; ++i) {
    const Time until = i < imu.size() ? std::min(imu[i].stamp, to) : to;
    const Duration step = until - time;
    const Time middle = time + step / 2;
    const Vector3 turn = rate.at(middle) * step.seconds();
    increment.velocity +=
        increment.rotation * so3_exp(0.5 * turn) * imu.specific_force_at(middle) * step.seconds();
    increment.rotation = (increment.rotation * so3_exp(turn)).normalized();
    time = until;
  }
  return increment;
}

std::optional<Vector3> InertialVelocity::acceleration(const TurnRate& rate, Time from, Time to,
                                                      const Eigen::Quaterniond& rotation,
                                                      const Vector3& velocity) const {
  if (!consistency_.helps() || to <= from || !rate.imu.covers(from, to, max_gap_)) return std::nullopt;
  const auto lever_at = [&](Time time) -> Vector3 { return rate.at(time).cross(imu_position_); };
  const double seconds = (to - from).seconds();
  const ImuIncrement increment = integrate_imu(rate, from, to, rotation);
  const Vector3 change = increment.velocity - consistency_.gravity_bias() * seconds;
  const Vector3 imu_velocity = rotation * (velocity + lever_at(from)) + change;
  const Vector3 later = increment.rotation.conjugate() * imu_velocity - lever_at(to);
  return (later - velocity) / seconds;
}

void InertialVelocity::update(const TurnRate& rate, const RegisteredMotion& motion, const Vector3& velocity,
                              const Vector3& share, bool only_weigh) {
  // The mean velocity equals the velocity at mid-interval.
  const Time time = motion.from + (motion.to - motion.from) / 2;
  const Eigen::Quaterniond rotation = so3_mean(motion.T_odom_from.rotation, motion.T_odom_to.rotation);
  if (!rate.imu.covers(time, time, max_gap_)) {
    interrupt();
    return;
  }
  const Past now{time, rotation, velocity, rotation * (velocity + rate.at(time).cross(imu_position_))};
  if (last_ && last_->time < time && rate.imu.covers(last_->time, time, max_gap_)) {
    AccelerometerConsistency::Evidence evidence;
    evidence.imu_change = integrate_imu(rate, last_->time, time, last_->rotation).velocity;
    evidence.measured = now.imu_velocity - last_->imu_velocity;
    evidence.held_error = share.cwiseProduct(now.velocity - last_->velocity).norm();
    const Matrix3 R = rotation.toRotationMatrix();
    evidence.seen = R * share.asDiagonal() * R.transpose();
    evidence.seconds = (time - last_->time).seconds();
    evidence.only_weigh = only_weigh;
    consistency_.update(evidence);
  }
  last_ = now;
}

}  // namespace nilio::core
