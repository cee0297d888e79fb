#include "nilio/core/pose_covariance.hpp"

#include <algorithm>

#include <Eigen/LU>

namespace nilio::core {

namespace {

// Share of a wrong prediction that deskewing leaves in a pose: for points evenly in time half of what the
// sweep was predicted wrong by, less what the map has in common with the scan, whose newest points come from
// scans bent alike.
constexpr double kDeskewShare = 1.0 / 3.0;

constexpr double kTranslationFloor = 0.002 * 0.002;
constexpr double kRotationFloor = 5e-5 * 5e-5;
constexpr double kUnobservedTranslation = 1.0;
constexpr double kUnobservedRotation = 0.1 * 0.1;
// What a vehicle's velocity may change by while it is not seen: m^2/s^2, rad^2/s^2.
constexpr double kUnseenSpeedSquare = 10.0 * 10.0;
constexpr double kUnseenTurnRateSquare = 1.0;

Vector6 predicted_variance(double seconds) {
  Vector6 variance;
  variance << Vector3::Constant(kUnseenSpeedSquare), Vector3::Constant(kUnseenTurnRateSquare);
  return variance * (seconds * seconds);
}

}  // namespace

void UnobservedDrift::advance(std::uint8_t weak_axes, const Vector6& prediction_square) {
  for (int i = 0; i < 6; ++i) {
    if ((weak_axes >> i & 1) == 0) {
      position_[i] = cross_[i] = velocity_[i] = 0.0;
      continue;
    }
    position_[i] += 2.0 * cross_[i] + velocity_[i] + prediction_square[i];
    cross_[i] += velocity_[i] + prediction_square[i];
    velocity_[i] += prediction_square[i];
  }
}

void fill_covariance(const PoseEvidence& evidence, OdometryResult& result) {
  Matrix6 covariance = Matrix6::Zero();
  covariance.diagonal() << kTranslationFloor, kTranslationFloor, kTranslationFloor, kRotationFloor,
      kRotationFloor, kRotationFloor;
  const NormalEquations& equations = evidence.registration.equations;
  if (result.predicted) {
    covariance.diagonal() += predicted_variance(evidence.predicted_s);
  } else if (equations.weight_sum > 0.0) {
    // Unobserved directions make H singular; a weak prior of their own size keeps the inverse finite.
    Matrix6 information = equations.H / measurement_variance(equations);
    information.diagonal().head<3>().array() += 1.0 / kUnobservedTranslation;
    information.diagonal().tail<3>().array() += 1.0 / kUnobservedRotation;
    covariance += information.inverse();
    covariance.diagonal() += kDeskewShare * kDeskewShare * evidence.prediction_square;
    covariance.diagonal() += evidence.drift;
  }
  const Matrix6 to_odom = block_rotation(result.T_odom_base.rotation.toRotationMatrix());
  result.pose_covariance = to_odom * covariance * to_odom.transpose();
  // The twist is the difference of two poses of equal quality.
  const double span_s = evidence.span_s;
  result.twist_covariance = span_s > 0.0 ? Matrix6(covariance * (2.0 / (span_s * span_s))) : covariance;
}

}  // namespace nilio::core
