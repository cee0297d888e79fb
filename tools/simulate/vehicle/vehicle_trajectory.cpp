#include "tools/simulate/vehicle/vehicle_trajectory.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace nilio::tools::simulate {

namespace {

using core::SE3;
using core::Vector3;

struct Basis {
  std::array<double, 3> value;
  std::array<double, 3> first;
  std::array<double, 3> second;
};

/// Cumulative basis of the uniform cubic B-spline at u in [0, 1]; derivatives by time.
Basis cumulative_basis(double u, double interval_s) {
  const double inv = 1.0 / interval_s;
  const double inv2 = inv * inv;
  return {{(5.0 + 3.0 * u - 3.0 * u * u + u * u * u) / 6.0,
           (1.0 + 3.0 * u + 3.0 * u * u - 2.0 * u * u * u) / 6.0, u * u * u / 6.0},
          {(0.5 - u + 0.5 * u * u) * inv, (0.5 + u - u * u) * inv, 0.5 * u * u * inv},
          {(u - 1.0) * inv2, (1.0 - 2.0 * u) * inv2, u * inv2}};
}

/// Extrapolates by the step from `inner` to `end`: keeps the speed at the ends.
SE3 extrapolate(const SE3& inner, const SE3& end) {
  return {(end.rotation * inner.rotation.conjugate() * end.rotation).normalized(),
          2.0 * end.translation - inner.translation};
}

}  // namespace

VehicleTrajectory::VehicleTrajectory(const std::vector<SE3>& control_poses, double interval_s)
    : interval_s_(interval_s), duration_s_(static_cast<double>(control_poses.size() - 1) * interval_s) {
  controls_.reserve(control_poses.size() + 2);
  controls_.push_back(extrapolate(control_poses[1], control_poses[0]));
  controls_.insert(controls_.end(), control_poses.begin(), control_poses.end());
  controls_.push_back(extrapolate(control_poses[control_poses.size() - 2], control_poses.back()));
  for (std::size_t i = 0; i + 1 < controls_.size(); ++i) {
    steps_.push_back(core::so3_log(controls_[i].rotation.conjugate() * controls_[i + 1].rotation));
  }
}

MotionState VehicleTrajectory::state(double time_s) const {
  MotionState motion = smooth_state(time_s);
  if (!body_) return motion;
  const BodyState body = body_->at(std::clamp(time_s, 0.0, duration_s_));
  const Eigen::Quaterniond& R = motion.T_world_base.rotation;
  const Vector3& w = motion.angular_velocity;
  const Vector3 d = body.displacement.head<3>();
  const Vector3 d1 = body.rate.head<3>();
  const Vector3 d2 = body.acceleration.head<3>();
  motion.T_world_base.translation += R * d;
  motion.velocity += R * (w.cross(d) + d1);
  motion.acceleration +=
      R * (motion.angular_acceleration.cross(d) + w.cross(w.cross(d)) + 2.0 * w.cross(d1) + d2);
  // The rotation vector is small: its right Jacobian to second order.
  const Vector3 phi = body.displacement.tail<3>();
  const Vector3 rate = body.rate.tail<3>();
  const Vector3 turning = body.acceleration.tail<3>();
  const Eigen::Quaterniond turn = core::so3_exp(phi);
  const Vector3 carried = turn.conjugate() * w;
  const Vector3 own = rate - 0.5 * phi.cross(rate) + phi.cross(phi.cross(rate)) / 6.0;
  motion.angular_acceleration = turn.conjugate() * motion.angular_acceleration - own.cross(carried) +
                                turning - 0.5 * phi.cross(turning);
  motion.angular_velocity = carried + own;
  motion.T_world_base.rotation = (R * turn).normalized();
  return motion;
}

VehicleTrajectory VehicleTrajectory::with_body(std::shared_ptr<const BodyMotion> body) const {
  VehicleTrajectory result = *this;
  result.body_ = std::move(body);
  return result;
}

RoadTravel VehicleTrajectory::travel() const {
  RoadTravel travel;
  double distance = 0.0;
  const auto count = static_cast<std::size_t>(duration_s_ / kBodyStepS) + 2;
  travel.speed_m_s.reserve(count);
  travel.distance_m.reserve(count);
  for (std::size_t i = 0; i < count; ++i) {
    const MotionState motion = smooth_state(static_cast<double>(i) * kBodyStepS);
    const double speed = (motion.T_world_base.rotation.conjugate() * motion.velocity).x();
    travel.speed_m_s.push_back(speed);
    travel.distance_m.push_back(distance);
    distance += speed * kBodyStepS;
  }
  return travel;
}

MotionState VehicleTrajectory::smooth_state(double time_s) const {
  const double position = std::clamp(time_s, 0.0, duration_s_) / interval_s_;
  const std::size_t segment = std::min(static_cast<std::size_t>(position), controls_.size() - 4);
  const Basis basis = cumulative_basis(position - static_cast<double>(segment), interval_s_);

  MotionState state;
  state.T_world_base = controls_[segment];
  for (std::size_t j = 0; j < 3; ++j) {
    const Vector3 delta = controls_[segment + j + 1].translation - controls_[segment + j].translation;
    state.T_world_base.translation += basis.value[j] * delta;
    state.velocity += basis.first[j] * delta;
    state.acceleration += basis.second[j] * delta;

    const Vector3& step = steps_[segment + j];
    const Eigen::Quaterniond factor = core::so3_exp(basis.value[j] * step);
    const Vector3 carried = factor.conjugate() * state.angular_velocity;
    state.angular_acceleration = factor.conjugate() * state.angular_acceleration +
                                 basis.first[j] * carried.cross(step) + basis.second[j] * step;
    state.angular_velocity = carried + basis.first[j] * step;
    state.T_world_base.rotation = state.T_world_base.rotation * factor;
  }
  state.T_world_base.rotation.normalize();
  return state;
}

std::vector<SE3> cut_drive(std::vector<SE3> poses, double interval_s, const DriveExtent& extent) {
  std::size_t count = poses.size();
  if (extent.duration_s > 0.0) {
    const double steps = std::ceil(extent.duration_s / interval_s);
    if (steps < static_cast<double>(count))
      count = std::max<std::size_t>(2, static_cast<std::size_t>(steps) + 1);
  }
  count = std::min(count, poses.size());
  if (extent.length_m > 0.0) {
    double length = 0.0;
    for (std::size_t i = 1; i < count; ++i) {
      length += (poses[i].translation - poses[i - 1].translation).norm();
      if (length >= extent.length_m) count = i + 1;
    }
  }
  poses.resize(count);
  return poses;
}

double path_length(const std::vector<SE3>& poses) {
  double length = 0.0;
  for (std::size_t i = 1; i < poses.size(); ++i) {
    length += (poses[i].translation - poses[i - 1].translation).norm();
  }
  return length;
}

}  // namespace nilio::tools::simulate
