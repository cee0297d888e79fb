#include "core/src/registration/point_factors.hpp"

#include "core/src/registration/gauss_newton.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace nilio::core {

namespace {

/// Adds a residual vector: `error` and its projector, both in the moving frame, of the moving point `p`.
void add_residual(const Vector3& p, const Vector3& error, const Matrix3& projector, const PlaneMetric& metric,
                  NormalEquations& equations) {
  const double square = error.squaredNorm();
  Vector6 along = Vector6::Zero();
  if (square > 0.0) along << error, p.cross(error);
  const double guess_variance = along.dot(metric.guess_covariance * along) / std::max(square, 1e-12);
  const double scale_square = metric.kernel_square(guess_variance);
  const double root = scale_square / (scale_square + square);
  const double weight = root * root;
  // J = [I, -skew(p)] in the moving frame.
  Eigen::Matrix<double, 3, 6> J;
  J.leftCols<3>().setIdentity();
  J.rightCols<3>() = -skew(p);
  equations.H.noalias() += weight * J.transpose() * projector * J;
  equations.b.noalias() += weight * J.transpose() * error;
  equations.weighted_square_error += weight * square;
  equations.weight_sum += weight;
  equations.agreement += weight;
  ++equations.correspondences;
  if (square < metric.inlier_distance_m * metric.inlier_distance_m) ++equations.inliers;
}

}  // namespace

NormalEquations point_equations(const PointMap& map, std::span<const Eigen::Vector3f> points,
                                const SE3& T_map_moving, const PlaneMetric& metric) {
  const Matrix3 R = T_map_moving.rotation.toRotationMatrix();
  const Vector3 t = T_map_moving.translation;
  return reduce_points(points, [&](const Eigen::Vector3f& point, NormalEquations& equations) {
    const Vector3 p = point.cast<double>();
    const Vector3 q = R * p + t;
    std::array<PointMap::Neighbour, 1> nearest;
    if (map.find_nearest(q, metric.gate_m, nearest) == 0) return;
    const Vector3 error = R.transpose() * (q - nearest[0].position);
    add_residual(p, error, Matrix3::Identity(), metric, equations);
  });
}

NormalEquations line_equations(const PointMap& map, std::span<const Eigen::Vector3f> points,
                               const SE3& T_map_moving, const PlaneMetric& metric) {
  const Matrix3 R = T_map_moving.rotation.toRotationMatrix();
  const Vector3 t = T_map_moving.translation;
  return reduce_points(points, [&](const Eigen::Vector3f& point, NormalEquations& equations) {
    const Vector3 p = point.cast<double>();
    const Vector3 q = R * p + t;
    std::array<PointMap::Neighbour, 2> nearest;
    if (map.find_nearest(q, metric.gate_m, nearest) < nearest.size()) return;
    const Vector3 direction = R.transpose() * (nearest[1].position - nearest[0].position).normalized();
    const Matrix3 across = Matrix3::Identity() - direction * direction.transpose();
    const Vector3 error = across * (R.transpose() * (q - nearest[0].position));
    add_residual(p, error, across, metric, equations);
  });
}

RegistrationResult register_points(const PointMap& map, std::span<const Eigen::Vector3f> points,
                                   const SE3& T_map_guess, const PlaneMetric& metric,
                                   const SolverOptions& options) {
  RegistrationResult result;
  result.T_map_moving = T_map_guess;
  iterate([&](const SE3& T_map_moving) { return point_equations(map, points, T_map_moving, metric); },
          {WorkKind::kIcp, points.size()}, options, result);
  return result;
}

RegistrationResult register_lines(const PointMap& map, std::span<const Eigen::Vector3f> points,
                                  const SE3& T_map_guess, const PlaneMetric& metric,
                                  const SolverOptions& options) {
  RegistrationResult result;
  result.T_map_moving = T_map_guess;
  iterate([&](const SE3& T_map_moving) { return line_equations(map, points, T_map_moving, metric); },
          {WorkKind::kIcp, points.size()}, options, result);
  return result;
}

}  // namespace nilio::core
