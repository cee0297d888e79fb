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

/// Covariance of a chain of edges.
core::Matrix6 chain_covariance(std::span<const OdometryEdge> edges);
/// Chain of edges as one transform.
core::SE3 chain_transform(std::span<const OdometryEdge> edges);

/// Deviation of the odometry's vertical from the true one, rad.
inline constexpr double kTiltDeviation = 0.006;

}  // namespace nilio::mapping
