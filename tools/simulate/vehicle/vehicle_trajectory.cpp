#include "tools/simulate/vehicle/vehicle_trajectory.hpp"

#include <algorithm>
#include <array>
#include <cmath>

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
