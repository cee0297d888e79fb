#include "tools/inspect/imu_calibration/imu_calibration.hpp"

#include "nilio/core/units.hpp"

#include "core/src/imu_monitor/gyro_alignment.hpp"
#include "tools/inspect/imu_calibration/axis_permutation.hpp"
#include "tools/inspect/imu_calibration/force_alignment.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <Eigen/LU>

namespace nilio::tools::inspect {

namespace {

constexpr double kStandardGravity = 9.80665;
constexpr int kOffsetRounds = 10;
constexpr double kOffsetSettled = 2e-3;
// Smaller offsets are within the drift of a host's clock and a bus.
constexpr double kMinimumOffset = 5e-3;
constexpr double kMinimumScaleError = 0.03;
constexpr double kUnitTolerance = 0.1;
// Larger angles mean another axis rather than a misalignment.
constexpr double kSameAxis = 45.0 / kDegreesPerRadian;
// Minimum error of the registered directions of rotation.
constexpr double kMinimumGyroSigma = 0.5 / kDegreesPerRadian;
// Rotations within this tolerance of an axis permutation are snapped to it.
constexpr double kAxesTolerance = 2.0 / kDegreesPerRadian;
constexpr double kLargestAxesTolerance = 6.0 / kDegreesPerRadian;

core::ImuBuffer shifted_buffer(std::span<const core::ImuSample> samples, const Eigen::Quaterniond& R_base_imu,
                               core::Duration shift) {
  core::ImuBuffer buffer(std::max<std::size_t>(samples.size(), 1));
  for (core::ImuSample sample : samples) {
    sample.stamp = sample.stamp - shift;
    buffer.add(sample, R_base_imu);
  }
  return buffer;
}

core::GyroAlignmentEstimate fit_rotation(std::span<const core::RegisteredMotion> motions,
                                         const core::ImuBuffer& imu, core::Duration max_gap) {
  core::GyroAlignment fit;
  for (const core::RegisteredMotion& motion : motions) {
    if (!imu.covers(motion.from - core::kLargestShift, motion.to + core::kLargestShift, max_gap)) continue;
    std::array<core::Vector3, core::kTimeShifts> rates;
    for (std::size_t i = 0; i < core::kTimeShifts; ++i)
      rates[i] =
          core::mean_angular_velocity(imu, motion.from + core::shift_at(i), motion.to + core::shift_at(i));
    fit.add(motion.mean_rate(), rates);
  }
  return fit.estimate();
}

ScaleCorrection check_scale(double ratio, double sigma, std::initializer_list<double> units) {
  ScaleCorrection result;
  if (!(ratio > 0.0)) return result;
  result.known = true;
  result.sigma = sigma;
  if (std::abs(ratio - 1.0) < kMinimumScaleError + 3.0 * sigma) return result;
  result.factor = 1.0 / ratio;
  for (const double unit : units) {
    if (std::abs(ratio * unit - 1.0) > kUnitTolerance) continue;
    result.factor = unit;
    result.is_unit = true;
  }
  return result;
}

std::vector<DirectionPair> gyro_pairs(const core::GyroAlignmentEstimate& rotation) {
  std::vector<DirectionPair> pairs;
  for (std::size_t k = 0; k < rotation.observed; ++k) {
    const core::ObservedDirection& d = rotation.directions[k];
    // A weak direction is contaminated by the strongest one.
    if (k > 0 && !d.strong) continue;
    pairs.push_back({d.gyro, d.registered.normalized(), std::max(d.angle_sigma, kMinimumGyroSigma)});
  }
  return pairs;
}

double angle_of(const core::Vector3& a, const core::Vector3& b) {
  return std::acos(std::clamp(a.normalized().dot(b.normalized()), -1.0, 1.0));
}

/// Agreement of the gyroscope with the accelerometer's axes: same, opposite sign, or none.
enum class Agreement { kSame, kOpposite, kNone };

Agreement compare_axes(const std::vector<DirectionPair>& gyro, const core::Matrix3& accel_axes) {
  bool same = true;
  bool opposite = true;
  for (const DirectionPair& pair : gyro) {
    const double angle = angle_of(accel_axes * pair.measured, pair.actual);
    same = same && angle < kSameAxis;
    opposite = opposite && angle > std::numbers::pi - kSameAxis;
  }
  return same ? Agreement::kSame : opposite ? Agreement::kOpposite : Agreement::kNone;
}

double largest_seen(const std::array<double, 3>& sigma) {
  double largest = 0.0;
  for (const double value : sigma)
    if (std::isfinite(value)) largest = std::max(largest, value);
  return largest;
}

/// Snaps to an axis permutation within `tolerance`: of the IMU's axes, whose configured mounting then stays,
/// or of the mounting itself.
core::Matrix3 round_to_axes(const core::Matrix3& actual, const core::Matrix3& configured, double tolerance,
                            bool& along_axes) {
  const core::Matrix3 swapped = configured.transpose() * actual;
  const core::Matrix3 whole_swap = nearest_axes(swapped);
  const core::Matrix3 whole = nearest_axes(actual);
  along_axes = true;
  if (angle_between(whole_swap, swapped) < tolerance) return configured * whole_swap;
  if (angle_between(whole, actual) < tolerance) return whole;
  along_axes = false;
  return actual;
}

void set_orientation(const AxesFit& fit, const core::Matrix3& configured, ImuCalibration& result) {
  result.rotation_sigma = fit.sigma;
  const double tolerance = std::clamp(3.0 * largest_seen(fit.sigma), kAxesTolerance, kLargestAxesTolerance);
  result.fitted_angle = angle_between(fit.matrix, core::Matrix3::Identity());
  if (result.fitted_angle < tolerance) return;
  const core::Matrix3 actual =
      round_to_axes(fit.matrix * configured, configured, tolerance, result.along_axes);
  const MirroredRotation split = split_mirror(actual);
  result.R_base_imu = Eigen::Quaterniond(split.rotation).normalized();
  result.negate_gyro = split.negated;
  result.negate_accel = split.negated;
  result.orientation_changed = true;
}

/// Negates gyro axes only: the axis of each direction, or all if it is along none of the IMU's axes.
void negate_gyro_alone(const std::vector<DirectionPair>& gyro, const Eigen::Quaterniond& R_base_imu,
                       ImuCalibration& result) {
  for (const DirectionPair& pair : gyro) {
    const core::Vector3 in_imu = R_base_imu.conjugate() * pair.measured;
    Eigen::Index axis = 0;
    if (in_imu.cwiseAbs().maxCoeff(&axis) < std::cos(kSameAxis)) {
      result.negate_gyro.fill(true);
      break;
    }
    auto& negated = result.negate_gyro[static_cast<std::size_t>(axis)];
    negated = true;
  }
  result.orientation_changed = true;
}

void find_orientation(const std::vector<DirectionPair>& gyro, const ForceComparison& forces,
                      const Eigen::Quaterniond& R_base_imu, ImuCalibration& result) {
  result.R_base_imu = R_base_imu;
  result.mirror_known = forces.spans_space;
  const core::Matrix3 configured = R_base_imu.toRotationMatrix();
  const AxesFit by_force = fit_axes(forces.pairs, forces.spans_space);
  const Agreement agreement = by_force.known ? compare_axes(gyro, by_force.matrix) : Agreement::kSame;
  std::vector<DirectionPair> pairs = forces.pairs;
  if (agreement == Agreement::kSame) pairs.insert(pairs.end(), gyro.begin(), gyro.end());
  const AxesFit fit = fit_axes(pairs, forces.spans_space);
  if (!fit.known) return;
  if (agreement == Agreement::kNone || (agreement == Agreement::kOpposite && !forces.spans_space)) {
    result.axes_disagree = true;
    return;
  }
  set_orientation(fit, configured, result);
  if (agreement == Agreement::kOpposite) negate_gyro_alone(gyro, R_base_imu, result);
}

void check_offset(ImuCalibration& result) {
  const double least = std::max(kMinimumOffset, 3.0 * result.time_offset_sigma_s);
  result.time_offset_matters = std::abs(result.time_offset_s) > least;
}

/// Finds the offset iteratively, each time with samples shifted by the previous result: the fit has a limited
/// range and is most accurate near 0.
core::GyroAlignmentEstimate find_offset(std::span<const core::RegisteredMotion> motions,
                                        std::span<const core::ImuSample> samples, const ImuMounting& mounting,
                                        ImuCalibration& result) {
  double offset_s = 0.0;
  core::GyroAlignmentEstimate rotation;
  for (int round = 0; round < kOffsetRounds; ++round) {
    const core::ImuBuffer imu =
        shifted_buffer(samples, mounting.T_base_imu.rotation, core::Duration::from_seconds(offset_s));
    rotation = fit_rotation(motions, imu, mounting.max_gap);
    if (!rotation.time_offset_found) break;
    offset_s += rotation.time_offset_s;
    result.time_offset_known = rotation.time_offset_known;
    result.time_offset_sigma_s = rotation.time_offset_sigma_s;
    if (std::abs(rotation.time_offset_s) < kOffsetSettled) break;
    if (std::abs(offset_s) > kLargestCorrectableOffset) break;
  }
  const bool at_edge = std::abs(rotation.time_offset_s) > 0.9 * core::kLargestShift.seconds();
  if (at_edge || std::abs(offset_s) > kLargestCorrectableOffset) result.time_offset_known = false;
  if (!result.time_offset_known) return rotation;
  result.time_offset_s = offset_s;
  check_offset(result);
  return rotation;
}

void refine_scale(const ScaleCorrection& rest, ScaleCorrection& scale) {
  if (!rest.known) return;
  scale.is_unit = scale.is_unit && rest.factor == 1.0;
  scale.factor *= rest.factor;
  scale.sigma = rest.sigma;
  scale.known = true;
}

}  // namespace

ImuCalibration calibrate_imu(std::span<const core::RegisteredMotion> motions,
                             std::span<const core::ImuSample> samples, const ImuMounting& mounting) {
  ImuCalibration result;
  result.R_base_imu = mounting.T_base_imu.rotation;
  const core::GyroAlignmentEstimate rotation = find_offset(motions, samples, mounting, result);
  if (rotation.observed > 0) {
    const core::ObservedDirection& strongest = rotation.directions[0];
    const double ratio = 1.0 / strongest.registered.norm();
    result.gyro = check_scale(ratio, strongest.angle_sigma, {kDegreesPerRadian, 1.0 / kDegreesPerRadian});
  }
  const core::ImuBuffer imu = shifted_buffer(samples, mounting.T_base_imu.rotation,
                                             core::Duration::from_seconds(result.time_offset_s));
  const ForceComparison forces =
      compare_forces(motions, imu, mounting.T_base_imu.translation, mounting.max_gap);
  result.accel = check_scale(forces.gravity_ratio, 0.0,
                             {kStandardGravity, 1.0 / kStandardGravity, 1e-3 * kStandardGravity});
  find_orientation(gyro_pairs(rotation), forces, mounting.T_base_imu.rotation, result);
  return result;
}

ImuCalibration refine(const ImuCalibration& first, const ImuCalibration& rest) {
  ImuCalibration result = first;
  if (rest.time_offset_known) {
    // An offset below the threshold was not applied.
    result.time_offset_s = rest.time_offset_s + (first.time_offset_matters ? first.time_offset_s : 0.0);
    result.time_offset_sigma_s = rest.time_offset_sigma_s;
    result.time_offset_known = true;
    check_offset(result);
  }
  refine_scale(rest.gyro, result.gyro);
  refine_scale(rest.accel, result.accel);
  result.rotation_sigma = rest.rotation_sigma;
  result.mirror_known = rest.mirror_known;
  result.axes_disagree = rest.axes_disagree;
  if (!rest.orientation_changed) return result;
  result.orientation_changed = true;
  result.R_base_imu = rest.R_base_imu;
  result.along_axes = rest.along_axes && (first.along_axes || !first.orientation_changed);
  for (std::size_t i = 0; i < 3; ++i) {
    result.negate_gyro[i] = first.negate_gyro[i] != rest.negate_gyro[i];
    result.negate_accel[i] = first.negate_accel[i] != rest.negate_accel[i];
  }
  return result;
}

core::Vector3 roll_pitch_yaw(const core::Matrix3& rotation) {
  const double pitch = std::asin(std::clamp(-rotation(2, 0), -1.0, 1.0));
  constexpr double kUpright = 1.0 - 1e-9;
  if (std::abs(rotation(2, 0)) > kUpright) return {0.0, pitch, std::atan2(-rotation(0, 1), rotation(1, 1))};
  return {std::atan2(rotation(2, 1), rotation(2, 2)), pitch, std::atan2(rotation(1, 0), rotation(0, 0))};
}

}  // namespace nilio::tools::inspect
