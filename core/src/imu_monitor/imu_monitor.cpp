#include "core/src/imu_monitor/imu_monitor.hpp"

#include "nilio/core/units.hpp"

#include "core/src/imu_monitor/accelerometer_alignment.hpp"
#include "core/src/imu_monitor/check_table.hpp"
#include "core/src/imu_monitor/gyro_alignment.hpp"
#include "core/src/imu_monitor/gyro_trust.hpp"
#include "core/src/imu_monitor/signal_statistics.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace nilio::core {

namespace {

constexpr double kLeastGyroFullScale = 5.0 / kDegreesPerRadian;
// An IMU at rest measures 9.81.
constexpr double kLeastAccelFullScale = 12.0;
// Samples unchanged for longer count as stuck; single repeats are normal.
constexpr Duration kStuckAfter = Duration::from_milliseconds(100.0);
// Memory of the bias in scans; above the calm rate, errors of scale and mounting would look like bias.
constexpr double kBiasMemory = 1.0 - 1.0 / 200.0;
constexpr double kCalmRate = 1.0 / kDegreesPerRadian;
constexpr double kLeastBiasWeight = 10.0;
// Longer motions span more than one scan.
constexpr double kLongestMotion = 0.35;
// An offset estimated from scans deskewed without the gyro is wrong by up to a tenth of a scan, so the
// correction is repeated until the remainder is below this.
constexpr double kLeastShiftSeconds = 0.002;
constexpr double kShiftSigmas = 3.0;
constexpr double kLargestTotalShiftSeconds = 0.15;
// Motions waiting for the samples of the largest shift: two scans at 20 Hz more than that takes.
constexpr std::size_t kPending = 8;

}  // namespace

struct ImuMonitor::State {
  explicit State(const ImuMonitorConfig& configuration)
      : config(configuration), timing(configuration.max_gap) {}

  void judge_rotation(const ImuBuffer& imu, const Vector3& gyro_bias, const RegisteredMotion& motion);
  void learn_pending(const ImuBuffer& imu);
  void learn_shifts(const ImuBuffer& imu, const RegisteredMotion& motion);
  [[nodiscard]] bool signal_is_sound(Time from, Time to) const;
  [[nodiscard]] bool force_is_sound(Time since) const {
    return accel.unchanged() < kStuckAfter && !accel.clipped_since(since);
  }
  bool fill_table(Time now);
  void fill_signals(Time now);
  bool fill_rotation();
  void fill_offset(const RotationEstimate& estimate);
  void fill_bias();
  bool follow_offset(const RotationEstimate& estimate);
  void fill_force();
  void withdraw(ImuCheck reason);

  ImuMonitorConfig config;
  TriadSignal gyro{kLeastGyroFullScale};
  TriadSignal accel{kLeastAccelFullScale};
  SampleTiming timing;
  RotationFit rotation;
  ForceFit force;
  GyroTrust trust;
  ImuHealth health;

  std::array<RegisteredMotion, kPending> pending{};
  std::size_t first_pending = 0;
  std::size_t pending_count = 0;
  Duration shift;
  Vector3 bias_sum = Vector3::Zero();
  double bias_weight = 0.0;
};

ImuMonitor::ImuMonitor(const ImuMonitorConfig& config) : state_(std::make_unique<State>(config)) {}
ImuMonitor::ImuMonitor(ImuMonitor&&) noexcept = default;
ImuMonitor& ImuMonitor::operator=(ImuMonitor&&) noexcept = default;
ImuMonitor::~ImuMonitor() = default;

const ImuHealth& ImuMonitor::health() const { return state_->health; }
const Vector3& ImuMonitor::registered_rate() const { return state_->trust.registered_rate(); }

Duration ImuMonitor::time_shift() const { return state_->shift; }

void ImuMonitor::add(const ImuSample& sample) {
  state_->timing.add(sample.stamp);
  state_->gyro.add(sample.stamp - state_->shift, sample.angular_velocity);
  state_->accel.add(sample.stamp - state_->shift, sample.linear_acceleration);
}

bool ImuMonitor::State::signal_is_sound(Time from, Time to) const {
  return from < to && gyro.unchanged() < kStuckAfter && !gyro.clipped_since(from);
}

bool ImuMonitor::usable(Time from, Time to) const {
  return state_->health.trusted && state_->signal_is_sound(from, to);
}

bool ImuMonitor::force_usable(Time since) const {
  const ImuHealth& health = state_->health;
  const auto is_bad = [&](ImuCheck check) { return health[check].state == ImuCheckState::kBad; };
  // Gyro and accelerometer share mounting and clock.
  constexpr std::array kGeometry{ImuCheck::kGravityMagnitude, ImuCheck::kGravityDirection,
                                 ImuCheck::kAccelMounting, ImuCheck::kGyroAxes, ImuCheck::kGyroMounting};
  return state_->force_is_sound(since) && health.reason != ImuCheck::kGyroAgreement &&
         std::none_of(kGeometry.begin(), kGeometry.end(), is_bad);
}

bool ImuMonitor::contradicts(const ImuBuffer& imu, const Vector3& gyro_bias,
                             const RegisteredMotion& motion) const {
  const Vector3 gyro = mean_angular_velocity(imu, motion.from, motion.to) - gyro_bias;
  return state_->trust.contradicted(gyro, motion.mean_rate(), motion.seconds());
}

void ImuMonitor::demote() {
  state_->trust.withdraw();
  state_->withdraw(ImuCheck::kGyroAgreement);
}

void ImuMonitor::State::withdraw(ImuCheck reason) {
  if (health.trusted) ++health.demotions;
  health.trusted = false;
  health.reason = reason;
}

void ImuMonitor::skip() {
  state_->force.interrupt();
  state_->trust.interrupt();
}

bool ImuMonitor::observe(const ImuBuffer& imu, const Vector3& gyro_bias, const RegisteredMotion& motion) {
  State& s = *state_;
  if (!imu.latest()) return false;
  const bool covered = motion.from < motion.to && motion.seconds() < kLongestMotion &&
                       imu.covers(motion.from, motion.to, s.config.max_gap);
  if (!covered) {
    skip();
  } else {
    s.judge_rotation(imu, gyro_bias, motion);
    s.pending[(s.first_pending + s.pending_count) % kPending] = motion;
    if (s.pending_count < kPending) {
      ++s.pending_count;
    } else {
      s.first_pending = (s.first_pending + 1) % kPending;
    }
  }
  s.learn_pending(imu);
  return s.fill_table(motion.to);
}

void ImuMonitor::State::judge_rotation(const ImuBuffer& imu, const Vector3& gyro_bias,
                                       const RegisteredMotion& motion) {
  const Vector3 gyro_rate = mean_angular_velocity(imu, motion.from, motion.to);
  const Vector3 registered = motion.mean_rate();
  const bool sound = signal_is_sound(motion.from, motion.to);
  if (sound) trust.add(gyro_rate - gyro_bias, registered, motion.seconds());
  if (sound && registered.norm() < kCalmRate) {
    bias_sum = kBiasMemory * bias_sum + gyro_rate - registered;
    bias_weight = kBiasMemory * bias_weight + 1.0;
  }
  if (!force_is_sound(motion.from)) {
    force.interrupt();
    return;
  }
  force.add(motion.to, motion.T_odom_to, motion.T_odom_to * config.imu_position,
            mean_specific_force(imu, motion.from, motion.to));
}

void ImuMonitor::State::learn_pending(const ImuBuffer& imu) {
  while (pending_count > 0) {
    const RegisteredMotion& motion = pending[first_pending];
    const std::optional<Time> latest = imu.latest();
    if (!latest || *latest < motion.to + kLargestShift) return;
    if (imu.covers(motion.from - kLargestShift, motion.to + kLargestShift, config.max_gap) &&
        !gyro.clipped_since(motion.from - kLargestShift) && gyro.unchanged() < kStuckAfter) {
      learn_shifts(imu, motion);
    }
    first_pending = (first_pending + 1) % kPending;
    --pending_count;
  }
}

void ImuMonitor::State::learn_shifts(const ImuBuffer& imu, const RegisteredMotion& motion) {
  std::array<Vector3, kTimeShifts> rates;
  for (std::size_t i = 0; i < kTimeShifts; ++i)
    rates[i] = mean_angular_velocity(imu, motion.from + shift_at(i), motion.to + shift_at(i));
  rotation.add(motion.mean_rate(), rates);
}

/// Returns true if the time shift changed.
bool ImuMonitor::State::fill_table(Time now) {
  fill_signals(now);
  const bool shifted = fill_rotation();
  fill_force();
  const ImuCheck obstacle = find_obstacle(health);
  const bool was_trusted = health.trusted;
  if (obstacle != ImuCheck::kCount) {
    withdraw(obstacle);
  } else if (!trust.given()) {
    withdraw(trust.refused() ? ImuCheck::kGyroAgreement : ImuCheck::kCount);
  } else {
    health.trusted = true;
    health.reason = ImuCheck::kCount;
  }
  if (was_trusted && !health.trusted) trust.withdraw();
  // Scans deskewed with the gyro reveal its errors more exactly, so the fit starts again.
  if (!was_trusted && health.trusted) rotation = RotationFit();
  return shifted;
}

void ImuMonitor::State::fill_signals(Time now) {
  const auto set = [&](ImuCheck check, double value) { set_row(health, check, value); };
  if (const double loss = timing.loss(); loss >= 0.0) set(ImuCheck::kSampleLoss, 100.0 * loss);
  set(ImuCheck::kSampleGap, timing.longest_gap(now).seconds());
  set(ImuCheck::kGyroStuck, gyro.unchanged().seconds());
  set(ImuCheck::kAccelStuck, accel.unchanged().seconds());
  const double scale =
      health[ImuCheck::kGyroScale].state == ImuCheckState::kBad ? health[ImuCheck::kGyroScale].value : 1.0;
  set(ImuCheck::kGyroNoise, gyro.noise() / scale * kDegreesPerRadian);
  set(ImuCheck::kAccelVibration, accel.noise());
  set_flag_row(health, ImuCheck::kGyroSaturation, gyro.full_scale() * kDegreesPerRadian);
  set_flag_row(health, ImuCheck::kAccelSaturation, accel.full_scale());
}

bool ImuMonitor::State::fill_rotation() {
  const RotationEstimate estimate = rotation.estimate();
  // After a restart of the fit the earlier estimates stay until better ones exist.
  if (estimate.observed > 0) {
    fill_directions(estimate, health);
    fill_offset(estimate);
  }
  fill_bias();
  // Before the gyro is in use, deskewing at a constant rate distorts bends and would count against it. After
  // a rejection the row keeps its maximum: on a straight road any gyro agrees.
  const double disagreement = trust.gyro_error() * kDegreesPerRadian;
  const bool is_worse = trust.refused() && disagreement > health[ImuCheck::kGyroAgreement].value;
  if (trust.compared() && (health.trusted || is_worse))
    set_row(health, ImuCheck::kGyroAgreement, disagreement);
  return follow_offset(estimate);
}

void ImuMonitor::State::fill_offset(const RotationEstimate& estimate) {
  const bool was_known = health[ImuCheck::kTimeOffset].state != ImuCheckState::kUnknown;
  if (!estimate.time_offset_known && !(was_known && estimate.time_offset_found)) {
    if (shift.ns == 0) forget_row(health, ImuCheck::kTimeOffset);
    return;
  }
  health.time_offset_sigma_ms = 1e3 * estimate.time_offset_sigma_s;
  set_row(health, ImuCheck::kTimeOffset, 1e3 * (shift.seconds() + estimate.time_offset_s),
          health.time_offset_sigma_ms);
}

void ImuMonitor::State::fill_bias() {
  if (health[ImuCheck::kGyroScale].state == ImuCheckState::kBad) {
    forget_row(health, ImuCheck::kGyroBias);
  } else if (bias_weight >= kLeastBiasWeight) {
    Eigen::Index axis = 0;
    const Vector3 bias = bias_sum / bias_weight * kDegreesPerRadian;
    bias.cwiseAbs().maxCoeff(&axis);
    set_row(health, ImuCheck::kGyroBias, bias[axis]);
  }
}

/// Applies a significant time offset to the stamps unless another check of the gyro is bad.
bool ImuMonitor::State::follow_offset(const RotationEstimate& estimate) {
  const double rest_s = estimate.time_offset_s;
  const double total_s = shift.seconds() + rest_s;
  const bool is_large =
      std::abs(rest_s) > std::max(kLeastShiftSeconds, kShiftSigmas * estimate.time_offset_sigma_s);
  if (!estimate.time_offset_known || !is_large || std::abs(total_s) > kLargestTotalShiftSeconds) return false;
  const ImuCheck obstacle = find_obstacle(health);
  if (obstacle != ImuCheck::kCount && obstacle != ImuCheck::kTimeOffset) return false;
  shift = Duration::from_seconds(total_s);
  health.time_shift_ms = 1e3 * shift.seconds();
  rotation = RotationFit();
  trust.forget();
  pending_count = 0;
  return true;
}

void ImuMonitor::State::fill_force() {
  const ForceEstimate estimate = force.estimate();
  if (estimate.steady_known) {
    set_row(health, ImuCheck::kGravityMagnitude, estimate.steady.norm());
    const double cosine = estimate.steady.z() / std::max(1e-9, estimate.steady.norm());
    set_row(health, ImuCheck::kGravityDirection,
            std::acos(std::clamp(cosine, -1.0, 1.0)) * kDegreesPerRadian);
  }
  // The fit assumes small angles: a wrong magnitude or direction of gravity violates that.
  const bool plausible = health[ImuCheck::kGravityMagnitude].state != ImuCheckState::kBad &&
                         health[ImuCheck::kGravityDirection].state != ImuCheckState::kBad &&
                         health[ImuCheck::kTimeOffset].state != ImuCheckState::kBad;
  if (estimate.mounting_known && plausible) {
    set_row(health, ImuCheck::kAccelMounting, estimate.mounting.norm() * kDegreesPerRadian);
  } else {
    forget_row(health, ImuCheck::kAccelMounting);
  }
}

}  // namespace nilio::core
