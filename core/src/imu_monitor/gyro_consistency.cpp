#include "core/src/imu_monitor/gyro_consistency.hpp"

#include "nilio/core/units.hpp"

#include <algorithm>
#include <cmath>

namespace nilio::core {

namespace {

// Memory of ten scans.
constexpr double kConsistencyMemory = 0.9;
constexpr double kMinConsistencyWeight = 5.0;
// 0.05 deg is 2.6 cm at 30 m, the noise of a range: differences below it decide nothing.
constexpr double kIndifferent = 0.05 * kRadiansPerDegree;
// Rejection: the gyro's error is so many times that of a constant rate, and no error of its scale.
constexpr double kPlainlyWorse = 2.0;
constexpr double kContradiction = 0.3 * kRadiansPerDegree;
// Rotation of a scan that reveals a wrong gyro.
constexpr double kTurning = 0.3 * kRadiansPerDegree;
// Evidence is collected over one minute of turning. It suffices once the constant rate has accumulated this
// error (half a second's entry into a bend) and the gyro less than a sixth of it, which a late, misaligned
// (10 deg) or wrongly scaled gyro does not reach. After a rejection four times as much is required.
constexpr double kEvidenceMemory = 1.0 - 1.0 / 600.0;
constexpr double kEvidenceSquares = 0.3 * 0.3 * kRadiansPerDegree * kRadiansPerDegree;
constexpr double kEvidenceAfterRejection = 4.0;
constexpr double kLargestShareOfSquares = 1.0 / 36.0;
// Noise of a registered rotation, subtracted from the evidence.
constexpr double kNoiseSquares = 0.03 * 0.03 * kRadiansPerDegree * kRadiansPerDegree;

// Relative errors by scale and axes: of a gyro that no turn has shown, beyond which it is wrong, and the
// least of any.
constexpr double kUnknownScale = 0.3;
constexpr double kLeastScale = 0.01;

}  // namespace

double GyroConsistency::scale_deviation() const {
  const double squares = kUnknownScale * kUnknownScale * kEvidenceSquares + gyro_evidence_;
  return std::clamp(std::sqrt(squares / (kEvidenceSquares + turned_evidence_)), kLeastScale, kUnknownScale);
}

bool GyroConsistency::compared() const { return weight_ >= kMinConsistencyWeight; }

bool GyroConsistency::rejected() const {
  const bool is_worse =
      gyro_evidence_ > std::max(kEvidenceSquares, kPlainlyWorse * kPlainlyWorse * constant_evidence_);
  return !accepted_ && (rejected_ || (is_worse && scale_deviation() >= kUnknownScale));
}

double GyroConsistency::gyro_error() const {
  return weight_ > 0.0 ? std::sqrt(gyro_squares_ / weight_) : 0.0;
}

double GyroConsistency::constant_rate_error() const {
  return weight_ > 0.0 ? std::sqrt(constant_squares_ / weight_) : 0.0;
}

bool GyroConsistency::is_inconsistent(const Vector3& gyro, const Vector3& registered, double seconds) const {
  if (!has_rate_) return false;
  const double gyro_angle = (gyro - registered).norm() * seconds;
  const double constant_angle = (rate_ - registered).norm() * seconds;
  return gyro_angle > kContradiction && gyro_angle > kPlainlyWorse * constant_angle &&
         gyro_angle > kPlainlyWorse * gyro_error();
}

void GyroConsistency::reject() {
  accepted_ = false;
  rejected_ = true;
  gyro_evidence_ = 0.0;
  constant_evidence_ = 0.0;
  turned_evidence_ = 0.0;
}

void GyroConsistency::reset_evidence() {
  const bool accepted = accepted_;
  *this = GyroConsistency();
  accepted_ = accepted;
}

bool GyroConsistency::is_proven() const {
  const double needed = rejected_ ? kEvidenceAfterRejection * kEvidenceSquares : kEvidenceSquares;
  return constant_evidence_ > needed && gyro_evidence_ < kLargestShareOfSquares * constant_evidence_;
}

void GyroConsistency::gather_evidence(double gyro_angle, double constant_angle, double turned) {
  const auto excess = [](double angle) { return std::max(0.0, angle * angle - kNoiseSquares); };
  gyro_evidence_ = kEvidenceMemory * gyro_evidence_ + excess(gyro_angle);
  constant_evidence_ = kEvidenceMemory * constant_evidence_ + excess(constant_angle);
  turned_evidence_ = kEvidenceMemory * turned_evidence_ + turned * turned;
}

void GyroConsistency::update(double gyro_angle, double constant_angle, double turned) {
  gyro_squares_ = kConsistencyMemory * gyro_squares_ + gyro_angle * gyro_angle;
  constant_squares_ = kConsistencyMemory * constant_squares_ + constant_angle * constant_angle;
  turned_squares_ = kConsistencyMemory * turned_squares_ + turned * turned;
  weight_ = kConsistencyMemory * weight_ + 1.0;
  if (!compared()) return;
  if (turned > kTurning) gather_evidence(gyro_angle, constant_angle, turned);
  const double gyro = gyro_error();
  const double constant = std::max(constant_rate_error(), kIndifferent);
  const double scaled = kUnknownScale * std::sqrt(turned_squares_ / weight_);
  if ((accepted_ || turned > kTurning) && gyro > std::max(kPlainlyWorse * constant, scaled)) reject();
  if (!accepted_ && gyro <= constant && is_proven()) {
    accepted_ = true;
    rejected_ = false;
  }
}

void GyroConsistency::add(const Vector3& gyro, const Vector3& registered, double seconds) {
  if (has_rate_) {
    update((gyro - registered).norm() * seconds, (rate_ - registered).norm() * seconds,
           registered.norm() * seconds);
  }
  rate_ = registered;
  has_rate_ = true;
}

}  // namespace nilio::core
