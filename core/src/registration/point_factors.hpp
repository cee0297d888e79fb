#pragma once

#include "core/src/map/point_voxel_map.hpp"
#include "core/src/registration/registration.hpp"

#include <span>

namespace nilio::core {

/// The metrics that NI-LIO compares its point-to-plane ICP with. Gate, kernel and inlier distance of the
/// metric are taken of the distance between a point and its point or line; `max_planarity` has no meaning.

/// Point-to-point equations: r = T p - nearest (Besl and McKay 1992).
NormalEquations point_equations(const PointMap& map, std::span<const Eigen::Vector3f> points,
                                const SE3& T_map_moving, const PlaneMetric& metric);

/// Point-to-line equations: r = distance of T p to the line through the two nearest stored points (Censi
/// 2008, in space).
NormalEquations line_equations(const PointMap& map, std::span<const Eigen::Vector3f> points,
                               const SE3& T_map_moving, const PlaneMetric& metric);

/// Gauss-Newton with re-association in every iteration.
RegistrationResult register_points(const PointMap& map, std::span<const Eigen::Vector3f> points,
                                   const SE3& T_map_guess, const PlaneMetric& metric,
                                   const SolverOptions& options);
RegistrationResult register_lines(const PointMap& map, std::span<const Eigen::Vector3f> points,
                                  const SE3& T_map_guess, const PlaneMetric& metric,
                                  const SolverOptions& options);

}  // namespace nilio::core
