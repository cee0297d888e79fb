#include "tools/simulate/sensors/imu_grade.hpp"

#include "nilio/core/units.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace nilio::tools::simulate {

using core::Matrix3;
using core::Vector3;

namespace {

constexpr double kMicroG = 1e-6 * 9.80665;
constexpr double kDegree = kRadiansPerDegree;
constexpr double kPerHour = kDegree / 3600.0;
constexpr double kLeastFilterRateHz = 1000.0;
constexpr double kWarmUpK = 15.0;
constexpr double kWarmUpS = 600.0;

/// In degrees, hours and micro-g.
struct Row {
  double gyro_noise, gyro_in_run, correlation_s, gyro_walk, gyro_start, gyro_per_k, gyro_per_g;
  double accel_noise, accel_in_run, accel_start, accel_per_k;
  double gyro_scale_percent, accel_scale_percent, axes_deg, package_deg;
  double gyro_step, accel_step_mg, bandwidth_hz, delay_s, gyro_range_deg_s, accel_range_g;
};

constexpr Row row_of(ImuGrade grade) {
  switch (grade) {
    case ImuGrade::kConsumer:
      return {.010, 30, 200, 4e-4, .5, .02, .1, 180, 80, .25, .005, 1, 1, .6, 1, .0, 0, 50, .010, 500, 8};
    case ImuGrade::kAutomotive:
      return {.02, 50, 300, 4e-4, .5, .03, .05, 300, 200, .3, .005, 2, 2, .5, 1, .1, 10, 20, .015, 163, 4.2};
    case ImuGrade::kIndustrial:
      return {.007, 10, 300, 1e-4, .1, .005, .01, 100,  30,  .03, .001,
              .2,   .2, .05, .3,   .0, 0,    100, .004, 450, 16};
    case ImuGrade::kTactical:
      break;
  }
  return {.002, 1,   600, 1e-5, .005, .0005, .002, 30,    5,   .01, .0003,
          .03,  .05, .02, .1,   .0,   0,     100,  .0035, 450, 16};
}

double wide(RandomStream& random, double sigma) { return sigma * random.gaussian(); }

}  // namespace

const std::vector<std::string>& imu_grade_names() {
  static const std::vector<std::string> names{"consumer", "automotive", "industrial", "tactical"};
  return names;
}

ImuGradeModel model_of(ImuGrade grade) {
  const Row row = row_of(grade);
  ImuGradeModel model;
  model.gyroscope = {row.gyro_noise * kDegree,      row.gyro_in_run * kPerHour,
                     row.gyro_walk * kDegree,       row.gyro_start * kDegree,
                     row.gyro_per_k * kDegree,      row.gyro_per_g * kDegree / kGravity,
                     0.01 * row.gyro_scale_percent, row.axes_deg * kDegree,
                     row.gyro_step * kDegree,       row.gyro_range_deg_s * kDegree};
  model.accelerometer = {row.accel_noise * kMicroG,
                         row.accel_in_run * kMicroG,
                         0.0,
                         row.accel_start,
                         row.accel_per_k,
                         0.0,
                         0.01 * row.accel_scale_percent,
                         row.axes_deg * kDegree,
                         1000.0 * row.accel_step_mg * kMicroG,
                         row.accel_range_g * 9.80665};
  model.correlation_s = row.correlation_s;
  model.package_rad = row.package_deg * kDegree;
  model.bandwidth_hz = row.bandwidth_hz;
  model.delay_s = row.delay_s;
  return model;
}

GradedImu::GradedImu(ImuGrade grade, const ImuModelConfig& config, const VehicleTrajectory& trajectory)
    : model_(model_of(grade)),
      config_(config),
      trajectory_(trajectory),
      gyro_random_(config.seed, 54),
      accel_random_(config.seed, 55),
      gyroscope_(draw(model_.gyroscope, gyro_random_)),
      accelerometer_(draw(model_.accelerometer, accel_random_)),
      steps_per_sample_(static_cast<std::uint64_t>(std::ceil(kLeastFilterRateHz / config.rate_hz))),
      step_s_(1.0 / (config.rate_hz * static_cast<double>(steps_per_sample_))),
      sample_count_(static_cast<std::uint64_t>(trajectory.duration_s() * config.rate_hz + 1e-6) + 1) {
  // Two equal poles have their common -3 dB point at 0.64 of each one's.
  const double corner_hz = model_.bandwidth_hz / std::sqrt(std::numbers::sqrt2 - 1.0);
  gain_ = 1.0 - std::exp(-2.0 * std::numbers::pi * corner_hz * step_s_);
  RandomStream random(config.seed, 56);
  const Vector3 turn(wide(random, model_.package_rad), wide(random, model_.package_rad),
                     wide(random, model_.package_rad));
  config_.T_base_imu.rotation = config_.T_base_imu.rotation * core::so3_exp(turn);
  const TrueInertia start = true_inertia(trajectory, config_.T_base_imu, 0.0);
  first_ << start.angular_velocity, start.specific_force;
  second_ = first_;
}

GradedImu::Axis3 GradedImu::draw(const InertialErrors& errors, RandomStream& random) const {
  Axis3 unit;
  for (Eigen::Index row = 0; row < 3; ++row) {
    unit.bias[row] = wide(random, errors.start_bias);
    unit.in_run[row] = wide(random, errors.in_run);
    unit.per_kelvin[row] = wide(random, errors.per_kelvin);
    for (Eigen::Index column = 0; column < 3; ++column) {
      unit.distortion(row, column) += wide(random, row == column ? errors.scale : errors.axes_rad);
      unit.per_g(row, column) = wide(random, errors.per_g);
    }
  }
  return unit;
}

Vector3 GradedImu::measure(const InertialErrors& errors, Axis3& unit, const Vector3& truth,
                           const Vector3& force, double kelvin, RandomStream& random) const {
  const double period_s = 1.0 / config_.rate_hz;
  const double decay = std::exp(-period_s / model_.correlation_s);
  const double driven = errors.in_run * std::sqrt(1.0 - decay * decay);
  const double noise = errors.noise_density * std::sqrt(0.5 * config_.rate_hz);
  Vector3 value = unit.distortion * truth + unit.bias + unit.in_run + unit.walked + kelvin * unit.per_kelvin +
                  unit.per_g * force;
  for (Eigen::Index axis = 0; axis < 3; ++axis) {
    value[axis] += noise * random.gaussian();
    unit.in_run[axis] = decay * unit.in_run[axis] + driven * random.gaussian();
    unit.walked[axis] += errors.walk * std::sqrt(period_s) * random.gaussian();
    if (errors.full_scale > 0.0) value[axis] = std::clamp(value[axis], -errors.full_scale, errors.full_scale);
    if (errors.step > 0.0) value[axis] = errors.step * std::round(value[axis] / errors.step);
  }
  return value;
}

void GradedImu::filter_until(double time_s) {
  for (; static_cast<double>(step_) * step_s_ < time_s - 0.5 * step_s_; ++step_) {
    const TrueInertia truth =
        true_inertia(trajectory_, config_.T_base_imu, static_cast<double>(step_ + 1) * step_s_);
    Six now;
    now << truth.angular_velocity, truth.specific_force;
    first_ += gain_ * (now - first_);
    second_ += gain_ * (first_ - second_);
  }
}

core::ImuSample GradedImu::next() {
  const double time_s = static_cast<double>(index_++) / config_.rate_hz;
  filter_until(time_s);
  const Vector3 rate_truth = second_.head<3>();
  const Vector3 force_truth = second_.tail<3>();
  const double kelvin = kWarmUpK * (1.0 - std::exp(-time_s / kWarmUpS));
  const Vector3 rate = measure(model_.gyroscope, gyroscope_, rate_truth, force_truth, kelvin, gyro_random_);
  const Vector3 force =
      measure(model_.accelerometer, accelerometer_, force_truth, force_truth, kelvin, accel_random_);
  core::ImuSample sample;
  sample.stamp = config_.start + core::Duration::from_seconds(time_s + model_.delay_s);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    sample.angular_velocity[axis] = rate[static_cast<Eigen::Index>(axis)];
    sample.linear_acceleration[axis] = force[static_cast<Eigen::Index>(axis)];
  }
  return sample;
}

}  // namespace nilio::tools::simulate
