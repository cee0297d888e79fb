#include "core/src/registration/point_factors.hpp"

#include "core/src/registration/gauss_newton.hpp"
#include "core/src/registration/point_sums.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace nilio::core {

namespace {

/// Adds the residual vector `error` of a point at `q` (map axes, from the origin of the moving frame) along
/// the directions that `projector` leaves.
void add_residual(const Vector3& q, const Vector3& error, const Matrix3& projector, const PlaneMetric& metric,
                  const Matrix6& guess_covariance, PointSums& sums) {
  const double square = error.squaredNorm();
  Vector6 gradient;
  gradient << error, q.cross(error);
  const double guess_variance = gradient.dot(guess_covariance * gradient) / std::max(square, 1e-12);
  const double scale_square = metric.kernel_square(guess_variance);
  const double root = scale_square / (scale_square + square);
  const double weight = root * root;
  sums.H += weight * packed_information(projector, q);
  sums.b += weight * gradient;
  sums.weighted_square_error += weight * square;
  sums.weight_sum += weight;
  sums.agreement += weight;
  ++sums.correspondences;
  if (square < metric.inlier_distance_m * metric.inlier_distance_m) ++sums.inliers;
}

/// Covariance of the guess in map axes.
Matrix6 guess_covariance_in_map(const PlaneMetric& metric, const Matrix3& R_map_moving) {
  const Matrix6 D = block_rotation(R_map_moving);
  return D * metric.guess_covariance * D.transpose();
}

}  // namespace

NormalEquations point_equations(const PointMap& map, std::span<const Eigen::Vector3f> points,
                                const SE3& T_map_moving, const PlaneMetric& metric) {
  const Matrix3 R = T_map_moving.rotation.toRotationMatrix();
  const Vector3 t = T_map_moving.translation;
  const Matrix6 guess_covariance = guess_covariance_in_map(metric, R);
  const PointSums total = sum_points(points, [&](const Eigen::Vector3f& point, PointSums& sums) {
    const Vector3 q = R * point.cast<double>();
    std::array<PointMap::Neighbour, 1> nearest;
    if (map.find_nearest(q + t, metric.gate_m, nearest) == 0) return;
    const Vector3 error = q + t - nearest[0].position;
    add_residual(q, error, Matrix3::Identity(), metric, guess_covariance, sums);
  });
  return total.in_moving_axes(R);
}

NormalEquations line_equations(const PointMap& map, std::span<const Eigen::Vector3f> points,
                               const SE3& T_map_moving, const PlaneMetric& metric) {
  const Matrix3 R = T_map_moving.rotation.toRotationMatrix();
  const Vector3 t = T_map_moving.translation;
  const Matrix6 guess_covariance = guess_covariance_in_map(metric, R);
  const PointSums total = sum_points(points, [&](const Eigen::Vector3f& point, PointSums& sums) {
    const Vector3 q = R * point.cast<double>();
    std::array<PointMap::Neighbour, 2> nearest;
    if (map.find_nearest(q + t, metric.gate_m, nearest) < nearest.size()) return;
    const Vector3 direction = (nearest[1].position - nearest[0].position).normalized();
    const Matrix3 across = Matrix3::Identity() - direction * direction.transpose();
    const Vector3 error = across * (q + t - nearest[0].position);
    add_residual(q, error, across, metric, guess_covariance, sums);
  });
  return total.in_moving_axes(R);
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
