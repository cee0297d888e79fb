#include "core/src/estimation/motion_filter.hpp"

#include "nilio/core/units.hpp"

#include "core/src/estimation/stationary_detector.hpp"
#include "core/src/linear_algebra.hpp"

#include <algorithm>
#include <array>

namespace nilio::core {

namespace {

using Vector = MotionFilter::Vector;
using Matrix = MotionFilter::Matrix;
constexpr auto kPose = MotionFilter::kPose;
constexpr auto kRotation = MotionFilter::kRotation;
constexpr auto kVelocity = MotionFilter::kVelocity;
constexpr auto kRate = MotionFilter::kRate;
constexpr auto kGyroBias = MotionFilter::kGyroBias;
constexpr auto kAccelBias = MotionFilter::kAccelBias;
constexpr auto kGravityBlock = MotionFilter::kGravityBlock;
constexpr auto kTilt = MotionFilter::kTilt;
constexpr auto kManoeuvre = MotionFilter::kManoeuvre;

// Noise of an automotive IMU on a vibrating vehicle: five times the densities of data sheets
// (0.01 deg/s and 300 ug per root hertz).
constexpr double kGyroDensity = 5.0 * 0.01 * kRadiansPerDegree;
constexpr double kAccelerometerDensity = 5.0 * 300e-6 * kGravity;
// Scale, axes and delay of automotive accelerometers: a fiftieth of the acceleration, for seconds
// (2 a^2 tau).
constexpr double kAccelerometerScale = 0.02;
constexpr double kAccelerometerScaleSeconds = 1.0;
// Random walks, per root second.
constexpr double kGyroBiasWalk = 4e-4 * kRadiansPerDegree;
constexpr double kAccelBiasWalk = 1e-3;
// Tilt of the map: odometry drifts by 0.2 to 0.5 degrees in 100 m (KITTI odometry benchmark); per root metre.
constexpr double kTiltWalk = 0.02 * kRadiansPerDegree;
// Priors: bias at switch-on of automotive sensors, and the velocities of a moving start.
constexpr double kGyroBiasPrior = 0.5 * kRadiansPerDegree;
constexpr double kAccelBiasPrior = 0.3;
constexpr double kVelocityPrior = 10.0;
constexpr double kRatePrior = 0.3;
// Manoeuvres of a vehicle that no sensor measures. Over a gap they count as 2 m/s^2, and 0.3 rad/s^2 of yaw,
// for a second each; as 0.5 m/s^2, those of a recorded car in traffic over one to ten seconds, where scans do
// not show the speed. From scan to scan they last as long as the sway (Singer 1970: density 2 a^2 tau).
constexpr double kManoeuvreSeconds = 0.3;
constexpr double kManoeuvreVariance = 2.0 * 2.0 / kManoeuvreSeconds;
constexpr double kUnobservedVariance = 0.5 * 0.5 / kManoeuvreSeconds;
constexpr double kYawVariance = 0.3 * 0.3 / kManoeuvreSeconds;
// An axis beyond 99 % of its predicted deviation shows a manoeuvre, up to the limits of a road vehicle: for a
// second 1 g (upwards, too), and 10 rad/s^2 of yaw; its body sways by 30 deg/s at most.
constexpr double kManoeuvre99 = 6.63;
constexpr std::array kMaxScale{25.0, 25.0, 3000.0, 225.0, 225.0, 1111.0};
// Sway of the body: rates of roll and pitch are an Ornstein-Uhlenbeck process.
constexpr double kSwaySeconds = 0.3;
constexpr double kSwayMemorySeconds = 5.0;
// Heave of the body, its vertical speed over a road, lasts as long.
constexpr double kHeaveSpeed = 0.1;
constexpr double kHeave = 2.0 * kHeaveSpeed * kHeaveSpeed / kSwaySeconds;
// Lower bounds of the pose's deviation: numerical.
constexpr double kMinMetres = 1e-4;
constexpr double kMinRadians = 1e-6;
// Sway of a stationary vehicle: displacements and velocities.
constexpr double kStationaryMetres = 0.005;
constexpr double kStationaryRadians = 0.05 * kRadiansPerDegree;
constexpr double kStationarySpeed = 0.02;
constexpr double kStationaryRate = 0.1 * kRadiansPerDegree;
// Squared Mahalanobis distance, 99.9 % of 3 degrees of freedom.
constexpr double kStationary999 = 16.27;
constexpr double kRelocatedMetres = 0.05;
constexpr double kRelocatedRadians = 0.2 * kRadiansPerDegree;
// Directions of the scan with less information, 1/m^2, say nothing.
constexpr double kMinInformation = 1.0;
// Longest step of the covariance, and of the integration of samples.
constexpr double kMaxStepSeconds = 0.1;
constexpr double kMaxSampleSeconds = 0.005;
// Longest motion that is predicted; what is before it is a jump of the clock, or nobody knows.
constexpr Duration kLongestPrediction = Duration::from_seconds(10.0);

Matrix3 variance_of(double deviation) { return deviation * deviation * Matrix3::Identity(); }

/// Variance of the manoeuvres that no sensor measures.
Vector3 manoeuvre_variance(const MotionInputs& inputs) {
  return {inputs.speed_is_observed ? kManoeuvreVariance : kUnobservedVariance, kManoeuvreVariance,
          kYawVariance};
}

/// Axis of a manoeuvre among those of the twist.
constexpr std::array kManoeuvreAxes{0, 1, 5};

bool is_measured(int axis, const MotionInputs& inputs) {
  return axis < 3 ? inputs.accelerometer : inputs.gyro;
}

Vector3 lever_velocity(const Vector3& rate, const Vector3& lever) { return rate.cross(lever); }

/// Errors that change by those of other states: pose and velocities. Manoeuvres decay, all others stay.
constexpr int kMoving = kRate + 3;
using MotionRows = Eigen::Matrix<double, kMoving, MotionFilter::kSize>;

/// These rows of F, error' = F error, for a twist, gravity in body axes and the inputs of a step.
MotionRows error_dynamics(const MotionState& s, const MotionInputs& inputs) {
  const Matrix3 W = skew(s.angular_velocity);
  const Matrix3 V = skew(s.velocity);
  const Matrix3 I = Matrix3::Identity();
  MotionRows F = MotionRows::Zero();
  F.block<3, 3>(kPose, kPose) = -W;
  F.block<3, 3>(kPose, kRotation) = -V;
  F.block<3, 3>(kPose, kVelocity) = I;
  F.block<3, 3>(kRotation, kRotation) = -W;
  // The rate's error is that of the gyro bias, or the state's.
  const Matrix3 by_rate = inputs.gyro ? Matrix3(-I) : I;
  const int rate = inputs.gyro ? kGyroBias : kRate;
  F.block<3, 3>(kRotation, rate) = by_rate;
  if (!inputs.gyro) F(kRate, kRate) = F(kRate + 1, kRate + 1) = -1.0 / kSwaySeconds;
  if (inputs.accelerometer) {
    const Matrix3 R = s.T_map_base.rotation.toRotationMatrix();
    F.block<3, 3>(kVelocity, kVelocity) = -W;
    F.block<3, 3>(kVelocity, rate) = V * by_rate;
    F.block<3, 3>(kVelocity, kRotation) = skew(R.transpose() * s.gravity);
    F.block<3, 3>(kVelocity, kGravityBlock) = R.transpose();
    F.block<3, 3>(kVelocity, kAccelBias) = -I;
  }
  for (int i = 0; i < 3; ++i)
    if (!is_measured(kManoeuvreAxes[i], inputs)) F(kVelocity + kManoeuvreAxes[i], kManoeuvre + i) = 1.0;
  return F;
}

using Tilting = Eigen::Matrix<double, MotionFilter::kSize, 3>;

/// Effect of a tilt of the map below the vehicle, in axes of base_link: gravity turns in the map and, as a
/// gyro that senses no turn tells, the pose.
Tilting tilting_of(const MotionState& s, const MotionInputs& inputs) {
  const Matrix3 R = s.T_map_base.rotation.toRotationMatrix();
  const Matrix3 gravity_change = -skew(s.gravity) * R;
  const Matrix3 horizontal = gravity_change.transpose() * gravity_change / (kGravity * kGravity);
  Tilting tilting = Tilting::Zero();
  tilting.middleRows<3>(kGravityBlock) = gravity_change;
  if (!inputs.gyro) return tilting;
  tilting.middleRows<3>(kRotation) = horizontal;
  tilting.middleRows<3>(kTilt) = -R * horizontal;
  return tilting;
}

/// Densities of the sensors' and the parameters' noise. `acceleration`: of base_link, m/s^2.
Matrix sensor_noise(const MotionState& s, const Vector3& acceleration, const MotionInputs& inputs,
                    double seconds) {
  Matrix Q = Matrix::Zero();
  const auto add = [&](int block, double density) {
    Q.block<3, 3>(block, block).diagonal().array() += density * density;
  };
  add(kGyroBias, kGyroBiasWalk);
  add(kAccelBias, kAccelBiasWalk);
  const Tilting tilting = tilting_of(s, inputs);
  Q += kTiltWalk * kTiltWalk * s.velocity.norm() * tilting * tilting.transpose();
  if (inputs.gyro) {
    const double scale = inputs.gyro_scale_deviation * s.angular_velocity.norm();
    Eigen::Matrix<double, 6, 3> G;  // rotation and, where it is integrated in turning axes, velocity
    G.topRows<3>().setIdentity();
    G.bottomRows<3>() = inputs.accelerometer ? skew(s.velocity) : Matrix3::Zero();
    const double density = kGyroDensity * kGyroDensity + scale * scale * seconds;
    Q.block<6, 6>(kRotation, kRotation) += density * G * G.transpose();
  }
  if (inputs.accelerometer) {
    add(kVelocity, kAccelerometerDensity);
    add(kVelocity, std::sqrt(2.0 * kAccelerometerScaleSeconds) * kAccelerometerScale * acceleration.norm());
  }
  return Q;
}

/// Densities of motion that no sensor measures.
Matrix motion_noise(const MotionInputs& inputs, const Vector6& scale, const Eigen::Vector2d& sway_square) {
  Matrix Q = Matrix::Zero();
  Q.diagonal().segment<3>(kManoeuvre) = (2.0 / kManoeuvreSeconds) * manoeuvre_variance(inputs);
  if (!inputs.accelerometer) Q(kVelocity + 2, kVelocity + 2) = kHeave * scale[2];
  if (!inputs.gyro)
    Q.diagonal().segment<2>(kRate) = (2.0 / kSwaySeconds) * sway_square.cwiseProduct(scale.segment<2>(3));
  return Q;
}

/// Phi(t), the series of F t to the third power.
struct Transition {
  MotionRows motion = MotionRows::Identity();
  double manoeuvre = 1.0;

  Transition(const MotionRows& F, double t) {
    MotionRows term = motion;
    for (int power = 1; power <= 3; ++power) {
      const double share = t / power;
      MotionRows next = share * (term.leftCols<kMoving>() * F);
      next.rightCols<3>() -= (share / kManoeuvreSeconds) * term.rightCols<3>();
      term = next;
      motion += term;
    }
    const double x = t / kManoeuvreSeconds;
    manoeuvre = 1.0 - x + x * x / 2.0 - x * x * x / 6.0;
  }
  /// Phi P Phi^T.
  [[nodiscard]] Matrix carry(const Matrix& P) const {
    Matrix rows = P;
    rows.topRows<kMoving>().noalias() = motion * P;
    rows.bottomRows<3>() *= manoeuvre;
    Matrix result = rows;
    result.leftCols<kMoving>().noalias() = rows * motion.transpose();
    result.rightCols<3>() *= manoeuvre;
    return result;
  }
};

}  // namespace

MotionState propagated(const MotionState& state, const MotionInputs& inputs, Time to) {
  MotionState s = state;
  s.time = std::clamp(s.time, to - kLongestPrediction, to + kLongestPrediction);
  const Vector3& lever = inputs.imu_position;
  const Vector3 bias = s.gyro_bias;
  while (s.time != to) {
    // Backwards, too.
    const double left = (to - s.time).seconds();
    const double h = std::clamp(left, -kMaxSampleSeconds, kMaxSampleSeconds);
    const Time next = h == left ? to : s.time + Duration::from_seconds(h);
    const Time middle = s.time + (next - s.time) / 2;
    Vector3 rate = s.angular_velocity;
    Vector3 next_rate = rate;
    if (inputs.gyro) {
      s.angular_velocity = inputs.imu->angular_velocity_at(s.time) - bias;
      rate = inputs.imu->angular_velocity_at(middle) - bias;
      next_rate = inputs.imu->angular_velocity_at(next) - bias;
    } else {
      // exp(-h / tau) to second order: the same bits everywhere.
      const double x = h / kSwaySeconds;
      next_rate.head<2>() *= 1.0 - x + 0.5 * x * x;
      next_rate += h * s.angular_acceleration;
      rate = 0.5 * (rate + next_rate);
    }
    const Eigen::Quaterniond& R = s.T_map_base.rotation;
    const Eigen::Quaterniond half = R * so3_exp(0.5 * h * rate);
    const Eigen::Quaterniond R_next = (R * so3_exp(h * rate)).normalized();
    Vector3 velocity = s.velocity;
    if (inputs.accelerometer) {
      // At the IMU: base_link's velocity follows by the lever arm.
      const Vector3 force = inputs.imu->specific_force_at(middle) - s.accelerometer_bias;
      const Vector3 at_imu =
          R * (s.velocity + lever_velocity(s.angular_velocity, lever)) + (half * force + s.gravity) * h;
      velocity = R_next.conjugate() * at_imu - lever_velocity(next_rate, lever);
    } else {
      velocity += h * s.acceleration;
    }
    const double lasts = 1.0 - h / kManoeuvreSeconds;
    s.acceleration *= lasts;
    s.angular_acceleration *= lasts;
    s.T_map_base.translation += half * (0.5 * h * (s.velocity + velocity));
    s.T_map_base.rotation = R_next;
    s.velocity = velocity;
    s.angular_velocity = next_rate;
    s.time = next;
  }
  return s;
}

void MotionFilter::reset(const SE3& T_map_base, Time time) {
  const MotionState old = state_;
  const Matrix old_covariance = covariance_;
  state_ = {};
  state_.time = time;
  state_.T_map_base = T_map_base;
  begin_map();
  isolate(kVelocity, variance_of(kVelocityPrior));
  isolate(kRate, variance_of(kRatePrior));
  isolate(kGyroBias, variance_of(kGyroBiasPrior));
  isolate(kAccelBias, variance_of(kAccelBiasPrior));
  isolate(kGravityBlock, variance_of(kGravityPrior));
  isolate(kTilt, Matrix3::Zero());
  if (old_covariance(kGyroBias, kGyroBias) > 0.0) {
    // Sensors keep their biases through a reset of the map.
    state_.gyro_bias = old.gyro_bias;
    covariance_.block<3, 3>(kGyroBias, kGyroBias) = old_covariance.block<3, 3>(kGyroBias, kGyroBias);
  }
}

void MotionFilter::begin_map() {
  isolate(kPose, variance_of(kMinMetres));
  isolate(kRotation, variance_of(kMinRadians));
  forget_manoeuvres();
}

void MotionFilter::relocate(const SE3& T_map_base) {
  state_.T_map_base = T_map_base;
  isolate(kPose, variance_of(kRelocatedMetres));
  isolate(kRotation, variance_of(kRelocatedRadians));
  isolate(kVelocity, variance_of(kVelocityPrior));
  isolate(kRate, variance_of(kRatePrior));
  forget_manoeuvres();
}

void MotionFilter::move_clock(Duration by) {
  state_.time = state_.time + by;
  if (last_update_) last_update_ = *last_update_ + by;
}

void MotionFilter::set_twist(const Vector6& twist, const Vector6& variance) {
  forget_manoeuvres();
  state_.velocity = twist.head<3>();
  state_.angular_velocity = twist.tail<3>();
  isolate(kVelocity, variance.head<3>().asDiagonal());
  isolate(kRate, variance.tail<3>().asDiagonal());
}

void MotionFilter::set_gravity(const Vector3& specific_force, double variance) {
  state_.gravity = -specific_force;
  state_.accelerometer_bias.setZero();
  // The force is known, not how it is shared between gravity and bias.
  const Matrix3 R = state_.T_map_base.rotation.toRotationMatrix();
  const double bias = kAccelBiasPrior * kAccelBiasPrior;
  isolate(kAccelBias, bias * Matrix3::Identity());
  isolate(kGravityBlock, (bias + variance) * Matrix3::Identity());
  covariance_.block<3, 3>(kGravityBlock, kAccelBias) = bias * R;
  covariance_.block<3, 3>(kAccelBias, kGravityBlock) = bias * R.transpose();
}

void MotionFilter::step(const MotionInputs& inputs, Time to) {
  if (had_gyro_ && !inputs.gyro) {
    // The last rate of the gyro starts the constant one.
    isolate(kRate, covariance_.block<3, 3>(kGyroBias, kGyroBias));
    covariance_.diagonal().segment<3>(kRate).array() += kGyroDensity * kGyroDensity / kMaxStepSeconds;
  }
  had_gyro_ = inputs.gyro;
  const MotionState before = state_;
  state_ = propagated(state_, inputs, to);
  const double seconds = (to - before.time).seconds();
  MotionState middle = before;
  middle.velocity = 0.5 * (before.velocity + state_.velocity);
  middle.angular_velocity =
      so3_log(before.T_map_base.rotation.conjugate() * state_.T_map_base.rotation) / seconds;
  middle.T_map_base.rotation = so3_mean(before.T_map_base.rotation, state_.T_map_base.rotation);
  const MotionRows F = error_dynamics(middle, inputs);
  const Vector3 acceleration =
      (state_.velocity - before.velocity) / seconds + middle.angular_velocity.cross(middle.velocity);
  const Matrix noise = sensor_noise(middle, acceleration, inputs, seconds) +
                       motion_noise(inputs, manoeuvre_scale_, sway_square_);
  // The integral of Phi(t) Q Phi(t)^T over the step, by Simpson's rule.
  const Matrix share = (seconds / 6.0) * noise;
  covariance_ = (Transition(F, seconds).carry(covariance_ + share) +
                 Transition(F, 0.5 * seconds).carry(4.0 * share) + share)
                    .eval();
  if (inputs.gyro) {
    isolate(kRate, covariance_.block<3, 3>(kGyroBias, kGyroBias));
  }
  for (int i = 0; i < 3; ++i)
    if (is_measured(kManoeuvreAxes[i], inputs)) forget_manoeuvre(i, inputs);
  symmetrise();
}

void MotionFilter::propagate(const MotionInputs& inputs, Time to) {
  state_.time = std::clamp(state_.time, to - kLongestPrediction, to);
  const Vector3 variance = manoeuvre_variance(inputs);
  for (int i = 0; i < 3; ++i)
    covariance_(kManoeuvre + i, kManoeuvre + i) += (manoeuvre_scale_[kManoeuvreAxes[i]] - 1.0) * variance[i];
  while (state_.time < to) {
    const Duration left = to - state_.time;
    const Time next =
        left.seconds() > 1.5 * kMaxStepSeconds ? state_.time + Duration::from_seconds(kMaxStepSeconds) : to;
    step(inputs, next);
  }
}

bool MotionFilter::adapt_to_manoeuvre(const SE3& T_map_base, const MotionInputs& inputs) {
  const Vector6 moved = se3_log(state_.T_map_base.inverse() * T_map_base);
  bool adapts = false;
  for (int axis = 0; axis < 6; ++axis) {
    if (is_measured(axis, inputs)) continue;
    const double square = moved[axis] * moved[axis] / covariance_(axis, axis);
    if (square < kManoeuvre99) continue;
    const double scale = std::min(manoeuvre_scale_[axis] * square, kMaxScale[static_cast<std::size_t>(axis)]);
    adapts = adapts || scale > manoeuvre_scale_[axis];
    manoeuvre_scale_[axis] = scale;
  }
  return adapts;
}

MotionState MotionFilter::conditioned_on(const SE3& T_map_base) const {
  const Vector6 moved = se3_log(state_.T_map_base.inverse() * T_map_base);
  return conditioned_by(covariance_.leftCols<6>() * solve_ldlt(pose_covariance(), moved), T_map_base);
}

MotionState MotionFilter::conditioned_on(const SE3& T_map_base, const Vector6& twist) const {
  Vector12 moved;
  moved << se3_log(state_.T_map_base.inverse() * T_map_base), twist - state_.twist();
  return conditioned_by(covariance_.leftCols<12>() * solve_ldlt(motion_covariance(), moved), T_map_base);
}

MotionState MotionFilter::conditioned_by(const Vector& error, const SE3& T_map_base) const {
  MotionFilter conditioned = *this;
  conditioned.apply(error);
  conditioned.state_.T_map_base = T_map_base;
  return conditioned.state_;
}

void MotionFilter::apply(const Vector& error) {
  state_.T_map_base = state_.T_map_base * se3_exp(error.head<6>());
  state_.velocity += error.segment<3>(kVelocity);
  if (had_gyro_) {
    state_.angular_velocity -= error.segment<3>(kGyroBias);
  } else {
    state_.angular_velocity += error.segment<3>(kRate);
  }
  state_.gyro_bias += error.segment<3>(kGyroBias);
  state_.accelerometer_bias += error.segment<3>(kAccelBias);
  state_.gravity += error.segment<3>(kGravityBlock);
  state_.tilt += error.segment<3>(kTilt);
  state_.acceleration.head<2>() += error.segment<2>(kManoeuvre);
  state_.angular_acceleration.z() += error[kManoeuvre + 2];
}

void MotionFilter::update(const SE3& T_map_base, const Matrix6& information) {
  state_ = conditioned_on(T_map_base);
  // P - P_o S^-1 P_o^T.
  const Matrix6 gain = innovation_information(information);
  const Eigen::Matrix<double, kSize, 6> observed = covariance_.leftCols<6>();
  covariance_ -= observed * gain * observed.transpose();
  end_update();
}

void MotionFilter::update(const SE3& T_map_base, const Vector6& twist, const Matrix12& information) {
  state_ = conditioned_on(T_map_base, twist);
  const Matrix12 gain =
      solve_lu(Matrix12(Matrix12::Identity() + information * motion_covariance()), information);
  const Eigen::Matrix<double, kSize, 12> observed = covariance_.leftCols<12>();
  covariance_ -= observed * gain * observed.transpose();
  end_update();
}

void MotionFilter::end_update() {
  symmetrise();
  const auto keep = [&](int from, double deviation) {
    for (int i = from; i < from + 3; ++i)
      covariance_(i, i) = std::max(covariance_(i, i), deviation * deviation);
  };
  keep(kPose, kMinMetres);
  keep(kRotation, kMinRadians);
  manoeuvre_scale_.setOnes();
  estimate_sway();
  last_update_ = state_.time;
}

/// Expectation maximisation of the process noise: the mean square is that of the estimate and its variance.
void MotionFilter::estimate_sway() {
  if (!last_update_ || may_be_stationary()) return;
  const double share = (state_.time - *last_update_).seconds() / kSwayMemorySeconds;
  const Eigen::Vector2d square =
      state_.angular_velocity.head<2>().cwiseAbs2() + covariance_.diagonal().segment<2>(kRate);
  sway_square_ += std::clamp(share, 0.0, 1.0) * (square - sway_square_);
}

void MotionFilter::zero_motion_update(const SE3& T_map_base) {
  zero_velocity_update();
  state_.T_map_base = T_map_base;
  isolate(kPose, variance_of(kStationaryMetres));
  isolate(kRotation, variance_of(kStationaryRadians));
}

bool MotionFilter::may_be_stationary() const {
  const Matrix3 variance = covariance_.block<3, 3>(kVelocity, kVelocity);
  return state_.velocity.dot(variance.inverse() * state_.velocity) < kStationary999;
}

void MotionFilter::zero_velocity_update() {
  // Sequentially, one axis after the other.
  Vector error = Vector::Zero();
  const auto observe = [&](int i, double value, double deviation) {
    const Vector column = covariance_.col(i);
    const double variance = column[i] + deviation * deviation;
    error += column * ((-value - error[i]) / variance);
    covariance_ -= column * column.transpose() / variance;
  };
  for (int axis = 0; axis < 3; ++axis) observe(kVelocity + axis, state_.velocity[axis], kStationarySpeed);
  const int rate = had_gyro_ ? kGyroBias : kRate;
  for (int axis = 0; axis < 3; ++axis) {
    // With a gyro the rate's error is that of its bias, reversed.
    const double value = had_gyro_ ? -state_.angular_velocity[axis] : state_.angular_velocity[axis];
    observe(rate + axis, value, kStationaryRate);
  }
  apply(error);
  symmetrise();
}

double MotionFilter::normalised_innovation_squared(const SE3& T_map_base, const Matrix6& information) const {
  // x' P^-1 x + g' H^+ g with g = P^-1 x, where the gradients of scan and prior cancel.
  const Vector6 moved = se3_log(state_.T_map_base.inverse() * T_map_base);
  const Vector6 gradient = solve_ldlt(pose_covariance(), moved);
  const SymmetricEigen6 eigen = symmetric_eigen(information);
  double square = moved.dot(gradient);
  for (int i = 0; i < 6; ++i) {
    const double along = eigen.vectors.col(i).dot(gradient);
    if (eigen.values[i] > kMinInformation) square += along * along / eigen.values[i];
  }
  return square;
}

WeightedInnovation MotionFilter::weighted_innovation(const SE3& T_map_base,
                                                     const Matrix6& information) const {
  // The registered pose is where the gradients of scan and prior cancel: S^-1 v = P^-1 x.
  const Vector6 moved = se3_log(state_.T_map_base.inverse() * T_map_base);
  return {solve_ldlt(pose_covariance(), moved), innovation_information(information)};
}

Matrix6 MotionFilter::innovation_information(const Matrix6& information) const {
  return information_with(pose_covariance(), information);
}

double MotionFilter::squared_distance(const SE3& T_map_base) const {
  const Vector6 moved = se3_log(state_.T_map_base.inverse() * T_map_base);
  Matrix6 covariance = pose_covariance();
  covariance.topLeftCorner<3, 3>() += variance_of(kRelocatedMetres);
  covariance.bottomRightCorner<3, 3>() += variance_of(kRelocatedRadians);
  return moved.dot(solve_ldlt(covariance, moved));
}

Matrix6 MotionFilter::levelled_pose_covariance() const {
  Eigen::Matrix<double, 6, kSize> to_pose = Eigen::Matrix<double, 6, kSize>::Zero();
  to_pose.leftCols<6>().setIdentity();
  to_pose.block<3, 3>(kRotation, kTilt) = state_.T_map_base.rotation.toRotationMatrix().transpose();
  return to_pose * covariance_ * to_pose.transpose();
}

void MotionFilter::isolate(int block, const Matrix3& covariance) {
  covariance_.middleRows<3>(block).setZero();
  covariance_.middleCols<3>(block).setZero();
  covariance_.block<3, 3>(block, block) = covariance;
}

void MotionFilter::forget_manoeuvres() {
  state_.acceleration.setZero();
  state_.angular_acceleration.setZero();
  isolate(kManoeuvre, manoeuvre_variance({}).asDiagonal());
  manoeuvre_scale_.setOnes();
  last_update_.reset();
}

void MotionFilter::forget_manoeuvre(int i, const MotionInputs& inputs) {
  (i < 2 ? state_.acceleration[i] : state_.angular_acceleration.z()) = 0.0;
  covariance_.row(kManoeuvre + i).setZero();
  covariance_.col(kManoeuvre + i).setZero();
  covariance_(kManoeuvre + i, kManoeuvre + i) = manoeuvre_variance(inputs)[i];
}

void MotionFilter::symmetrise() { covariance_ = (0.5 * (covariance_ + covariance_.transpose())).eval(); }

}  // namespace nilio::core
