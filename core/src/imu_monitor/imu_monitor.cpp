#include "core/src/imu_monitor/imu_monitor.hpp"

#include "nilio/core/portable_math.hpp"
#include "nilio/core/units.hpp"

#include "core/src/imu_monitor/check_table.hpp"

#include <algorithm>
#include <cmath>

namespace nilio::core {

namespace {

// Memory of the bias in scans; above the calm rate, errors of scale and mounting would look like bias.
constexpr double kBiasMemory = 1.0 - 1.0 / 200.0;
constexpr double kCalmRate = kRadiansPerDegree;
constexpr double kMinBiasWeight = 10.0;
// Longer motions span more than one scan.
constexpr double kLongestMotion = 0.35;
// An offset estimated from scans deskewed without the gyro is wrong by up to a tenth of a scan, so the
// correction is repeated until the remainder is below this.
constexpr double kMinShiftSeconds = 0.002;
constexpr double kShiftSigmas = 3.0;
constexpr double kLargestTotalShiftSeconds = 0.15;

}  // namespace

ImuMonitor::ImuMonitor(const ImuMonitorConfig& config) : config_(config), timing_(config.max_gap) {}

void ImuMonitor::add(const ImuSample& sample) {
  timing_.add(sample.stamp);
  gyro_.add(sample.stamp - shift_, sample.angular_velocity);
  accel_.add(sample.stamp - shift_, sample.linear_acceleration);
}

bool ImuMonitor::signal_is_sound(Time from, Time to) const {
  return from < to && gyro_.unchanged() < kStuckAfter && !gyro_.clipped_since(from);
}

bool ImuMonitor::usable(Time from, Time to) const {
  return signal_is_sound(from, to) && !gyro_consistency_.rejected() &&
         find_obstacle(health_) == ImuCheck::kCount;
}

bool ImuMonitor::force_usable(Time since) const {
  const auto is_bad = [&](ImuCheck check) { return health_[check].state == ImuCheckState::kBad; };
  // Gyro and accelerometer share mounting and clock.
  constexpr std::array kGeometry{ImuCheck::kGravityMagnitude, ImuCheck::kGravityDirection,
                                 ImuCheck::kAccelMounting, ImuCheck::kGyroAxes, ImuCheck::kGyroMounting};
  return force_is_sound(since) && health_.reason != ImuCheck::kGyroAgreement &&
         std::none_of(kGeometry.begin(), kGeometry.end(), is_bad);
}

bool ImuMonitor::contradicts(const ImuBuffer& imu, const Vector3& gyro_bias,
                             const RegisteredMotion& motion) const {
  const Vector3 gyro_rate = mean_angular_velocity(imu, motion.from, motion.to) - gyro_bias;
  return gyro_consistency_.is_inconsistent(gyro_rate, motion.mean_rate(), motion.seconds());
}

void ImuMonitor::demote() {
  gyro_consistency_.reject();
  reject(ImuCheck::kGyroAgreement);
}

void ImuMonitor::reject(ImuCheck reason) {
  if (health_.trusted) ++health_.demotions;
  health_.trusted = false;
  health_.reason = reason;
}

void ImuMonitor::skip() {
  force_.interrupt();
  gyro_consistency_.interrupt();
}

void ImuMonitor::observe(const ImuBuffer& imu, const Vector3& gyro_bias, const RegisteredMotion& motion) {
  if (!imu.latest()) return;
  const bool covered = motion.from < motion.to && motion.seconds() < kLongestMotion &&
                       imu.covers(motion.from, motion.to, config_.max_gap);
  if (!covered) {
    skip();
  } else if (motion.shows_rotation) {
    compare_with_registration(imu, gyro_bias, motion);
    pending_[(first_pending_ + pending_count_) % kPending] = motion;
    if (pending_count_ < kPending) {
      ++pending_count_;
    } else {
      first_pending_ = (first_pending_ + 1) % kPending;
    }
  }
  process_pending(imu);
  fill_table(motion.to);
}

void ImuMonitor::compare_with_registration(const ImuBuffer& imu, const Vector3& gyro_bias,
                                           const RegisteredMotion& motion) {
  const Vector3 gyro_rate = mean_angular_velocity(imu, motion.from, motion.to);
  const Vector3 registered = motion.mean_rate();
  const bool sound = signal_is_sound(motion.from, motion.to);
  if (sound) gyro_consistency_.add(gyro_rate - gyro_bias, registered, motion.seconds());
  if (sound && registered.norm() < kCalmRate) {
    bias_sum_ = kBiasMemory * bias_sum_ + gyro_rate - registered;
    bias_weight_ = kBiasMemory * bias_weight_ + 1.0;
  }
  if (!force_is_sound(motion.from)) {
    force_.interrupt();
    return;
  }
  force_.add(motion.to, motion.T_odom_to, motion.T_odom_to * config_.imu_position,
             mean_specific_force(imu, motion.from, motion.to));
}

void ImuMonitor::process_pending(const ImuBuffer& imu) {
  while (pending_count_ > 0) {
    const RegisteredMotion& motion = pending_[first_pending_];
    const std::optional<Time> latest = imu.latest();
    if (!latest || *latest < motion.to + kLargestShift) return;
    if (imu.covers(motion.from - kLargestShift, motion.to + kLargestShift, config_.max_gap) &&
        !gyro_.clipped_since(motion.from - kLargestShift) && gyro_.unchanged() < kStuckAfter) {
      fit_time_shifts(imu, motion);
    }
    first_pending_ = (first_pending_ + 1) % kPending;
    --pending_count_;
  }
}

void ImuMonitor::fit_time_shifts(const ImuBuffer& imu, const RegisteredMotion& motion) {
  std::array<Vector3, kTimeShifts> rates;
  for (std::size_t i = 0; i < kTimeShifts; ++i)
    rates[i] = mean_angular_velocity(imu, motion.from + shift_at(i), motion.to + shift_at(i));
  rotation_.add(motion.mean_rate(), rates);
}

void ImuMonitor::fill_table(Time now) {
  fill_signals(now);
  fill_rotation();
  fill_force();
  const ImuCheck obstacle = find_obstacle(health_);
  const bool was_trusted = health_.trusted;
  if (obstacle != ImuCheck::kCount) {
    reject(obstacle);
  } else if (!gyro_consistency_.accepted()) {
    reject(gyro_consistency_.rejected() ? ImuCheck::kGyroAgreement : ImuCheck::kCount);
  } else {
    health_.trusted = true;
    health_.reason = ImuCheck::kCount;
  }
  if (was_trusted && !health_.trusted) gyro_consistency_.reject();
  // Scans deskewed with the gyro_ reveal its errors more exactly, so the fit starts again.
  if (!was_trusted && health_.trusted) rotation_ = GyroAlignment();
}

void ImuMonitor::fill_signals(Time now) {
  const auto set = [&](ImuCheck check, double value) { set_row(health_, check, value); };
  if (const double loss = timing_.loss(); loss >= 0.0) set(ImuCheck::kSampleLoss, 100.0 * loss);
  set(ImuCheck::kSampleGap, timing_.longest_gap(now).seconds());
  set(ImuCheck::kGyroStuck, gyro_.unchanged().seconds());
  set(ImuCheck::kAccelStuck, accel_.unchanged().seconds());
  const double scale =
      health_[ImuCheck::kGyroScale].state == ImuCheckState::kBad ? health_[ImuCheck::kGyroScale].value : 1.0;
  set(ImuCheck::kGyroNoise, gyro_.noise() / scale * kDegreesPerRadian);
  set(ImuCheck::kAccelVibration, accel_.noise());
  set_flag_row(health_, ImuCheck::kGyroSaturation, gyro_.full_scale() * kDegreesPerRadian);
  set_flag_row(health_, ImuCheck::kAccelSaturation, accel_.full_scale());
}

void ImuMonitor::fill_rotation() {
  const GyroAlignmentEstimate estimate = rotation_.estimate();
  // After a restart of the fit the earlier estimates stay until better ones exist.
  if (estimate.observed > 0) {
    fill_directions(estimate, health_);
    fill_offset(estimate);
  }
  fill_bias();
  // Before the gyro_ is in use, deskewing at a constant rate distorts bends and would count against it. After
  // a rejection the row keeps its maximum: on a straight road any gyro_ agrees.
  const double disagreement = gyro_consistency_.gyro_error() * kDegreesPerRadian;
  const bool is_worse =
      gyro_consistency_.rejected() && disagreement > health_[ImuCheck::kGyroAgreement].value;
  if (gyro_consistency_.compared() && (health_.trusted || is_worse))
    set_row(health_, ImuCheck::kGyroAgreement, disagreement);
  follow_offset(estimate);
}

void ImuMonitor::fill_offset(const GyroAlignmentEstimate& estimate) {
  const bool was_known = health_[ImuCheck::kTimeOffset].state != ImuCheckState::kUnknown;
  if (!estimate.time_offset_known && !(was_known && estimate.time_offset_found)) {
    if (shift_.ns == 0) clear_row(health_, ImuCheck::kTimeOffset);
    return;
  }
  health_.time_offset_sigma_ms = 1e3 * estimate.time_offset_sigma_s;
  set_row(health_, ImuCheck::kTimeOffset, 1e3 * (shift_.seconds() + estimate.time_offset_s),
          health_.time_offset_sigma_ms);
}

void ImuMonitor::fill_bias() {
  if (health_[ImuCheck::kGyroScale].state == ImuCheckState::kBad) {
    clear_row(health_, ImuCheck::kGyroBias);
  } else if (bias_weight_ >= kMinBiasWeight) {
    Eigen::Index axis = 0;
    const Vector3 bias = bias_sum_ / bias_weight_ * kDegreesPerRadian;
    bias.cwiseAbs().maxCoeff(&axis);
    set_row(health_, ImuCheck::kGyroBias, bias[axis]);
  }
}

/// Applies a significant time offset to the stamps unless another check of the gyro_ is bad.
void ImuMonitor::follow_offset(const GyroAlignmentEstimate& estimate) {
  const double rest_s = estimate.time_offset_s;
  const double total_s = shift_.seconds() + rest_s;
  const bool is_large =
      std::abs(rest_s) > std::max(kMinShiftSeconds, kShiftSigmas * estimate.time_offset_sigma_s);
  if (!estimate.time_offset_known || !is_large || std::abs(total_s) > kLargestTotalShiftSeconds) return;
  const ImuCheck obstacle = find_obstacle(health_);
  if (obstacle != ImuCheck::kCount && obstacle != ImuCheck::kTimeOffset) return;
  shift_ = Duration::from_seconds(total_s);
  health_.time_shift_ms = 1e3 * shift_.seconds();
  rotation_ = GyroAlignment();
  gyro_consistency_.reset_evidence();
  pending_count_ = 0;
}

void ImuMonitor::fill_force() {
  const AccelerometerAlignmentEstimate estimate = force_.estimate();
  if (estimate.steady_known) {
    set_row(health_, ImuCheck::kGravityMagnitude, estimate.steady.norm());
    const double cosine = estimate.steady.z() / std::max(1e-9, estimate.steady.norm());
    set_row(health_, ImuCheck::kGravityDirection,
            portable::acos(std::clamp(cosine, -1.0, 1.0)) * kDegreesPerRadian);
  }
  // The fit assumes small angles: a wrong magnitude or direction of gravity violates that.
  const bool plausible = health_[ImuCheck::kGravityMagnitude].state != ImuCheckState::kBad &&
                         health_[ImuCheck::kGravityDirection].state != ImuCheckState::kBad &&
                         health_[ImuCheck::kTimeOffset].state != ImuCheckState::kBad;
  if (estimate.mounting_known && plausible) {
    set_row(health_, ImuCheck::kAccelMounting, estimate.mounting.norm() * kDegreesPerRadian);
  } else {
    clear_row(health_, ImuCheck::kAccelMounting);
  }
}

}  // namespace nilio::core
