#include "mapping/loops/drift_model.hpp"

#include <algorithm>
#include <limits>

namespace nilio::mapping {

namespace {

using core::Matrix6;
using core::SE3;
using core::Vector3;
using core::Vector6;

// Noise of an edge, and random walk over its path: metres and radians, per root of a metre. From simulated
// drives, see docs/map.md.
constexpr double kNoiseMetres = 0.006;
constexpr double kWalkMetres = 0.0014;
constexpr double kNoiseRadians = 0.0001;
constexpr double kWalkRadians = 0.000035;
// Roll and pitch of odometry in relation to its heading.
constexpr double kTiltFactor = 3.0;
// Odometry of the field drifts by 0.5 to 1 % and 0.2 to 0.5 degrees in 100 m (KITTI odometry benchmark).
constexpr double kScaleBias = 0.005;
constexpr double kHeadingBias = 0.25 / 57.3 / 100.0;
constexpr double kHeightBias = 0.0015;
/// Of Gauss-Newton over the biases.
constexpr int kMaxIterations = 6;

}  // namespace

Vector6 walk_variance(const OdometryEdge& edge) {
  const double translation = kNoiseMetres * kNoiseMetres + kWalkMetres * kWalkMetres * edge.path_m;
  const double rotation = kNoiseRadians * kNoiseRadians + kWalkRadians * kWalkRadians * edge.path_m;
  Vector6 variance;
  const double tilt = kTiltFactor * kTiltFactor * rotation;
  variance << Vector3::Constant(translation), tilt, tilt, rotation;
  return variance;
}

BiasJacobian bias_jacobian(const OdometryEdge& edge) {
  // In axes of the target; z is vertical.
  const Vector3 t = edge.T_from_to.rotation.conjugate() * edge.T_from_to.translation;
  BiasJacobian J = BiasJacobian::Zero();
  J.col(0).head<3>() = t;
  J.col(1).head<3>() = 0.5 * edge.path_m * Vector3::UnitZ().cross(t);
  J(5, 1) = edge.path_m;
  J(2, 2) = edge.path_m;
  return J;
}

Eigen::Vector3d bias_deviation() { return {kScaleBias, kHeadingBias, kHeightBias}; }

Matrix6 Chain::covariance() const {
  const BiasJacobian bias = by_bias * bias_deviation().asDiagonal();
  return walk + bias * bias.transpose();
}

Chain chain(std::span<const OdometryEdge> edges, const Vector3& biases) {
  Chain result;
  for (const OdometryEdge& edge : edges) {
    const BiasJacobian J = bias_jacobian(edge);
    const SE3 T = edge.T_from_to * core::se3_exp(-J * biases);
    const Matrix6 Ad = core::adjoint(T.inverse());
    result.T_from_to = result.T_from_to * T;
    result.walk = Ad * result.walk * Ad.transpose();
    // Roll and pitch do not accumulate: what the walk gives them is within the tilt added below.
    Vector6 variance = walk_variance(edge);
    variance[3] = variance[4] = 0.0;
    result.walk.diagonal() += variance;
    result.by_bias = Ad * result.by_bias + J;
  }
  result.walk(3, 3) += 2.0 * kTiltDeviation * kTiltDeviation;
  result.walk(4, 4) += 2.0 * kTiltDeviation * kTiltDeviation;
  return result;
}

double chain_distance(std::span<const OdometryEdge> edges, const SE3& T_from_to, const Matrix6& covariance) {
  const Vector3 prior = bias_deviation().array().square().inverse();
  Vector3 biases = Vector3::Zero();
  double distance = std::numeric_limits<double>::infinity();
  for (int i = 0; i < kMaxIterations; ++i) {
    const Chain part = chain(edges, biases);
    const Vector6 error = core::se3_log(T_from_to.inverse() * part.T_from_to);
    const Eigen::LDLT<Matrix6> C(part.walk + covariance);
    distance = std::min(distance, biases.dot(prior.cwiseProduct(biases)) + error.dot(C.solve(error)));
    const BiasJacobian weighted = C.solve(part.by_bias);
    core::Matrix3 H = part.by_bias.transpose() * weighted;
    H.diagonal() += prior;
    biases -= H.ldlt().solve(prior.cwiseProduct(biases) - weighted.transpose() * error);
  }
  return distance;
}

}  // namespace nilio::mapping
