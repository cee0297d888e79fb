#include "core/src/preprocessing/beam_calibration.hpp"

#include "nilio/core/units.hpp"

#include <algorithm>
#include <optional>

#include <Eigen/LU>

namespace nilio::core {

namespace {

// Errors of the beams of a healthy sensor, 1 sigma: those of KITTI's HDL-64E, of which rings differ by 2 cm.
constexpr double kRangeDeviation = 0.025;
constexpr double kAngleDeviation = 0.1 * kRadiansPerDegree;
// Weight of a scan after the next one: voxels keep points with errors that were not yet corrected.
constexpr double kMemory = 0.99;
// Residuals of a beam share the errors of the planes, from scan to scan: those of so many scans count as one.
constexpr double kScansOfResidual = 4.0;
// Weight in a scan below which its residuals count as less.
constexpr double kMinWeight = 3.0;

/// Directions in which range, elevation and azimuth move a point.
struct BeamAxes {
  Vector3 along;
  Vector3 up;
  Vector3 left;
};

std::optional<BeamAxes> axes_of(const Vector3& point) {
  const double horizontal = point.head<2>().norm();
  if (!(horizontal > 0.0)) return std::nullopt;
  const double slope = point.z() / horizontal;
  return BeamAxes{
      point.normalized(), {-slope * point.x(), -slope * point.y(), horizontal}, {-point.y(), point.x(), 0.0}};
}

bool is_calibrated(float beam) { return beam >= 0.0F && beam < static_cast<float>(kMaxCalibratedBeams); }

}  // namespace

Eigen::Vector3f BeamCalibration::correct(const Eigen::Vector3f& point, float beam) const {
  if (!is_calibrated(beam)) return point;
  const Vector3 p = point.cast<double>();
  const std::optional<BeamAxes> axes = axes_of(p);
  if (!axes) return point;
  const Vector3& c = beams_[static_cast<std::size_t>(beam)].correction;
  return (p + c[0] * axes->along + c[1] * axes->up + c[2] * axes->left).cast<float>();
}

BeamCorrection BeamCalibration::correction_of(std::size_t beam) const {
  const Vector3& c = beams_[beam].correction;
  return {c[0], c[1], c[2]};
}

void BeamCalibration::add(const BeamResidual& residual) {
  if (!is_calibrated(residual.beam)) return;
  const std::optional<BeamAxes> axes = axes_of(residual.point);
  if (!axes) return;
  Beam& beam = beams_[static_cast<std::size_t>(residual.beam)];
  const Vector3& n = residual.normal;
  const Vector3 J(n.dot(axes->along), n.dot(axes->up), n.dot(axes->left));
  beam.scan_A += residual.weight * J * J.transpose();
  beam.scan_b += residual.weight * (J.dot(beam.correction) - residual.distance_m) * J;
  beam.scan_weight += residual.weight;
}

void BeamCalibration::update(double variance) {
  const Vector3 deviations(kRangeDeviation, kAngleDeviation, kAngleDeviation);
  const Matrix3 prior = deviations.cwiseAbs2().cwiseInverse().asDiagonal();
  for (Beam& beam : beams_) {
    if (!(beam.scan_weight > 0.0)) continue;
    const double share = 1.0 / (kScansOfResidual * variance * std::max(beam.scan_weight, kMinWeight));
    beam.A = kMemory * beam.A + share * beam.scan_A;
    beam.b = kMemory * beam.b + share * beam.scan_b;
    beam.correction = (beam.A + prior).inverse() * beam.b;
    beam.scan_A.setZero();
    beam.scan_b.setZero();
    beam.scan_weight = 0.0;
  }
  centre();
}

/// Errors that all beams share move the map with them and belong to the mounting. The mean is weighted by the
/// beams' information: an elevation that all beams on the ground share would tilt the trajectory.
void BeamCalibration::centre() {
  Vector3 sum = Vector3::Zero();
  Vector3 weight = Vector3::Zero();
  for (const Beam& beam : beams_) {
    if (!beam.is_seen()) continue;
    sum += beam.A.diagonal().cwiseProduct(beam.correction);
    weight += beam.A.diagonal();
  }
  const Vector3 mean = sum.cwiseQuotient(weight.cwiseMax(1e-9));
  for (Beam& beam : beams_) {
    if (beam.is_seen()) beam.correction -= mean;
  }
}

}  // namespace nilio::core
