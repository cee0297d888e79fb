#pragma once

#include "nilio/core/se3.hpp"

#include <span>

namespace nilio::mapping {

/// Motion between two consecutive places, as odometry measured it.
struct OdometryEdge {
  core::SE3 T_from_to;
  double path_m = 0.0;
};

using BiasJacobian = Eigen::Matrix<double, 6, 3>;

/// Drift of odometry: a random walk, and biases that are constant over a drive. Errors are
/// Log(T_true^-1 T_odom), in axes of the target: translation, then rotation. Roll and pitch are observed by
/// gravity, so that they do not drift.
///
/// Variances of the random walk over one edge.
core::Vector6 walk_variance(const OdometryEdge& edge);
/// Error of an edge for each unit of bias: scale; heading, rad/m; height, m/m.
BiasJacobian bias_jacobian(const OdometryEdge& edge);
/// Standard deviations of the biases.
Eigen::Vector3d bias_deviation();

/// Edges one after the other, with the derivatives and the covariance of their error.
struct Chain {
  core::SE3 T_from_to;
  BiasJacobian by_bias = BiasJacobian::Zero();  ///< error for each unit of bias
  core::Matrix6 walk = core::Matrix6::Zero();   ///< covariance for known biases

  [[nodiscard]] core::Matrix6 covariance() const;
};
/// `biases` of the odometry are taken out of the edges.
Chain chain(std::span<const OdometryEdge> edges, const Eigen::Vector3d& biases = Eigen::Vector3d::Zero());

/// Squared Mahalanobis distance of a measured transform, with the covariance of its error, from the chain:
/// that of the most probable biases. Not linear in them: a heading may be wrong by any angle. 6 degrees of
/// freedom.
double chain_distance(std::span<const OdometryEdge> edges, const core::SE3& T_from_to,
                      const core::Matrix6& covariance);

/// Deviation of the odometry's vertical from the true one, rad.
inline constexpr double kTiltDeviation = 0.006;

}  // namespace nilio::mapping
