#include "tools/simulate/sensors/imu_model.hpp"

#include <cmath>

namespace nilio::tools::simulate {

using core::Vector3;

namespace {

constexpr double kDriftTimeS = 300.0;

}  // namespace

ImuErrorProcess::ImuErrorProcess(const ImuErrors& errors, double rate_hz, RandomStream random)
    : errors_(errors),
      noise_per_sample_(errors.noise_density * std::sqrt(rate_hz)),
      decay_(std::exp(-1.0 / (rate_hz * kDriftTimeS))),
      random_(random) {
  for (Eigen::Index axis = 0; axis < 3; ++axis) {
    constant_[axis] = random_.chance(0.5) ? errors.constant_bias : -errors.constant_bias;
    in_run_[axis] = errors.drift * random_.gaussian();
  }
  for (double& scale : scale_) scale = random_.chance(0.5) ? 1.0 + errors.scale : 1.0 - errors.scale;
}

Vector3 ImuErrorProcess::next(const Vector3& truth) {
  Vector3 error = constant_ + in_run_;
  for (Eigen::Index axis = 0; axis < 3; ++axis) {
    error[axis] += noise_per_sample_ * random_.gaussian();
    // Keeps the standard deviation at `drift`.
    in_run_[axis] =
        decay_ * in_run_[axis] + errors_.drift * std::sqrt(1.0 - decay_ * decay_) * random_.gaussian();
  }
  return scale_.cwiseProduct(truth) + error;
}

TrueInertia true_inertia(const VehicleTrajectory& trajectory, const core::SE3& T_base_imu, double time_s) {
  const MotionState motion = trajectory.state(time_s);
  const Eigen::Quaterniond& rotation = motion.T_world_base.rotation;
  const Vector3& arm = T_base_imu.translation;
  const Vector3 turning = motion.angular_acceleration.cross(arm) +
                          motion.angular_velocity.cross(motion.angular_velocity.cross(arm));
  const Vector3 force = rotation.conjugate() * (motion.acceleration + Vector3(0.0, 0.0, kGravity)) + turning;
  const Eigen::Quaterniond to_imu = T_base_imu.rotation.conjugate();
  return {to_imu * motion.angular_velocity, to_imu * force};
}

ImuModel::ImuModel(const ImuModelConfig& config, const VehicleTrajectory& trajectory)
    : config_(config),
      trajectory_(trajectory),
      gyroscope_(config.gyroscope, config.rate_hz, RandomStream(config.seed, 51)),
      accelerometer_(config.accelerometer, config.rate_hz, RandomStream(config.seed, 52)),
      sample_count_(static_cast<std::uint64_t>(trajectory.duration_s() * config.rate_hz + 1e-6) + 1) {}

core::ImuSample ImuModel::next() {
  const double time_s = static_cast<double>(index_++) / config_.rate_hz;
  const TrueInertia truth = true_inertia(trajectory_, config_.T_base_imu, time_s);
  const Vector3 rate = gyroscope_.next(truth.angular_velocity);
  const Vector3 specific_force = accelerometer_.next(truth.specific_force);

  core::ImuSample sample;
  sample.stamp = config_.start + core::Duration::from_seconds(time_s);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    sample.angular_velocity[axis] = rate[static_cast<Eigen::Index>(axis)];
    sample.linear_acceleration[axis] = specific_force[static_cast<Eigen::Index>(axis)];
  }
  return sample;
}

}  // namespace nilio::tools::simulate
