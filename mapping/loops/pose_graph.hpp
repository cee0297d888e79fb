#pragma once

#include "nilio/core/se3.hpp"

#include <cstdint>
#include <span>
#include <vector>

#include "mapping/loops/drift_model.hpp"

namespace nilio::mapping {

/// Relative pose of two nodes that a loop closure measured; `reference` is the earlier one.
struct LoopEdge {
  std::size_t reference = 0;
  std::size_t moving = 0;
  core::SE3 T_reference_moving;
  /// Information of an error on the right, in axes of `moving`.
  core::Matrix6 information = core::Matrix6::Identity();
};

/// Measured position of a point that is fixed to a node, such as a GNSS antenna.
struct MeasuredPosition {
  std::size_t node = 0;                            ///< in a map: id of the submap
  core::Vector3 point = core::Vector3::Zero();     ///< in axes of the node
  core::Vector3 position = core::Vector3::Zero();  ///< in the frame of the measurements
  /// Standard deviations; infinite for an axis that was not measured.
  core::Vector3 deviation = core::Vector3::Ones();
  bool is_inlier = true;
};

/// Error of a measured position, in units of its deviations, and its derivatives.
struct PositionError {
  core::Vector3 error;
  Eigen::Matrix<double, 3, 6> by_node;   ///< translation in axes of the graph, rotation in those of the node
  Eigen::Matrix<double, 3, 4> by_frame;  ///< translation and heading of `T_measured_map`
};
PositionError position_error(const MeasuredPosition& measured, const core::SE3& node,
                             const core::SE3& T_measured_map);

struct GraphSolution {
  /// In the frame of the first node's pose.
  std::vector<core::SE3> poses;
  /// Of the odometry, see bias_jacobian().
  Eigen::Vector3d biases = Eigen::Vector3d::Zero();
  /// For each loop: whether it agrees with odometry and the rest.
  std::vector<bool> is_inlier;
  /// The same for measured positions.
  std::vector<bool> is_position_inlier;
  /// Frame of the measured positions; a rotation about z.
  core::SE3 T_measured_map;
};

/// Maximum-likelihood poses of nodes in a chain of odometry edges, with biases of the odometry as common
/// unknowns, verticals from gravity, and loops and measured positions of which some may be false: graduated
/// non-convexity (Yang et al. 2020) with the Geman-McClure kernel takes them out. `odometry`: poses of the
/// nodes, axes aligned with gravity; `edges[i]` from node i to i + 1. The first node keeps its pose; heading
/// and place of the frame of the positions, near those of the nodes, are unknowns. One thread; the same input
/// gives the same bits on one processor, and poses are rounded to about 1e-7 m so that they do on others.
GraphSolution optimise(std::span<const core::SE3> odometry, std::span<const OdometryEdge> edges,
                       std::span<const LoopEdge> loops, std::span<const MeasuredPosition> positions = {});

/// Squared Mahalanobis distance between the chain from loop `a` to loop `b` and both loops; 6 degrees of
/// freedom. `edges`: of the whole drive.
double cycle_error(const LoopEdge& a, const LoopEdge& b, std::span<const OdometryEdge> edges);

}  // namespace nilio::mapping
