#include "nilio/core/registration.hpp"

#include "registration_solver.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include <Eigen/Core>

namespace nilio::core {

namespace {

// A thinner plane has had too few points to show its thickness.
constexpr double kMinPlaneVariance = 0.01 * 0.01;

void add_upper(Matrix6& H, const Vector6& J, double weight) {
  for (int column = 0; column < 6; ++column) {
    const double weighted = weight * J[column];
    for (int row = 0; row <= column; ++row) H(row, column) += J[row] * weighted;
  }
}

/// Weight of a point at `offset` from the plane's mean, 1 = as good as the point itself. A plane is known
/// best where its points were: away from them the error of its normal grows with the square of the distance
/// in units of their spread.
double plane_weight(const VoxelSurface& surface, const Vector3& offset, double point_variance) {
  const float* packed = surface.information;
  const double square_distance =
      offset.x() * (packed[0] * offset.x() + 2.0 * (packed[1] * offset.y() + packed[2] * offset.z())) +
      offset.y() * (packed[3] * offset.y() + 2.0 * packed[4] * offset.z()) +
      offset.z() * packed[5] * offset.z();
  const double thickness = std::max(static_cast<double>(surface.thickness), kMinPlaneVariance);
  return point_variance / (point_variance + thickness * (1.0 + square_distance));
}

}  // namespace

NormalEquations& NormalEquations::operator+=(const NormalEquations& other) {
  H += other.H;
  b += other.b;
  weighted_square_error += other.weighted_square_error;
  weight_sum += other.weight_sum;
  normal_square += other.normal_square;
  correspondences += other.correspondences;
  inliers += other.inliers;
  return *this;
}

NormalEquations plane_equations(const VoxelMap& map, std::span<const Eigen::Vector3f> points,
                                const SE3& T_map_moving, const PlaneMetric& metric) {
  const Matrix3 R = T_map_moving.rotation.toRotationMatrix();
  const Vector3 t = T_map_moving.translation;
  const double scale_square = metric.kernel_scale_m * metric.kernel_scale_m;
  const double point_variance = metric.point_deviation_m * metric.point_deviation_m;
  const auto max_planarity = static_cast<float>(metric.max_planarity);
  return reduce_points(points, [&](const Eigen::Vector3f& point, NormalEquations& equations) {
    const Vector3 p = point.cast<double>();
    const Vector3 q = R * p + t;
    const VoxelIndex index = map.index_of(q);
    const VoxelSurface* surface = map.find(index);
    if (surface == nullptr || surface->planarity > max_planarity) return;
    const Vector3 normal = surface->normal.cast<double>();
    const Vector3 offset = q - map.corner_of(index) - surface->mean.cast<double>();
    const double residual = normal.dot(offset);
    if (std::abs(residual) > metric.gate_m) return;
    const double root = scale_square / (scale_square + residual * residual);
    const double weight = root * root * plane_weight(*surface, offset - residual * normal, point_variance);
    const Vector3 moving_normal = R.transpose() * normal;
    Vector6 J;
    J.head<3>() = moving_normal;
    J.tail<3>() = p.cross(moving_normal);
    add_upper(equations.H, J, weight);
    equations.b += (weight * residual) * J;
    equations.weighted_square_error += weight * residual * residual;
    equations.weight_sum += weight;
    equations.normal_square += weight * static_cast<double>(surface->planarity) / surface->count;
    ++equations.correspondences;
    if (std::abs(residual) < metric.inlier_distance_m) ++equations.inliers;
  });
}

NormalEquations ndt_equations(const VoxelMap& map, std::span<const Eigen::Vector3f> points,
                              const SE3& T_map_moving, const NdtMetric& metric) {
  static const std::array<VoxelIndex, 7> kNeighbours = {
      VoxelIndex(0, 0, 0),  VoxelIndex(1, 0, 0), VoxelIndex(-1, 0, 0), VoxelIndex(0, 1, 0),
      VoxelIndex(0, -1, 0), VoxelIndex(0, 0, 1), VoxelIndex(0, 0, -1)};
  const Matrix3 R = T_map_moving.rotation.toRotationMatrix();
  const Vector3 t = T_map_moving.translation;
  const double exponent = -0.5 / (metric.kernel_scale * metric.kernel_scale);
  return reduce_points(points, [&](const Eigen::Vector3f& point, NormalEquations& equations) {
    const Vector3 p = point.cast<double>();
    const Vector3 q = R * p + t;
    const VoxelIndex home = map.index_of(q);
    bool matched = false;
    for (const VoxelIndex& offset : kNeighbours) {
      const VoxelIndex index = home + offset;
      const VoxelSurface* surface = map.find(index);
      if (surface == nullptr) continue;
      const Vector3 error = q - map.corner_of(index) - surface->mean.cast<double>();
      Matrix3 information;
      const float* packed = surface->information;
      information << packed[0], packed[1], packed[2], packed[1], packed[3], packed[4], packed[2], packed[4],
          packed[5];
      const Vector3 weighted_error = information * error;
      const double square_distance = error.dot(weighted_error);
      const double weight = std::exp(exponent * square_distance);
      Eigen::Matrix<double, 3, 6> J;
      J.leftCols<3>() = R;
      J.rightCols<3>() = -R * skew(p);
      equations.H.noalias() += weight * J.transpose() * information * J;
      equations.b.noalias() += weight * J.transpose() * weighted_error;
      equations.weighted_square_error += weight * square_distance;
      equations.weight_sum += weight;
      matched = true;
    }
    if (matched) ++equations.correspondences;
  });
}

RegistrationResult register_planes(const VoxelMap& map, std::span<const Eigen::Vector3f> points,
                                   const SE3& T_map_guess, const PlaneMetric& metric,
                                   const SolverOptions& options) {
  RegistrationResult result;
  result.T_map_moving = T_map_guess;
  iterate([&](const SE3& T_map_moving) { return plane_equations(map, points, T_map_moving, metric); },
          options, result);
  return result;
}

RegistrationResult register_ndt(const VoxelMap& map, std::span<const Eigen::Vector3f> points,
                                const SE3& T_map_guess, std::span<const double> kernel_scales,
                                const SolverOptions& options) {
  RegistrationResult result;
  result.T_map_moving = T_map_guess;
  for (const double scale : kernel_scales) {
    iterate([&](const SE3& T_map_moving) { return ndt_equations(map, points, T_map_moving, {scale}); },
            options, result);
    if (result.stop_reason != StopReason::kConverged && result.stop_reason != StopReason::kMaxIterations)
      break;
  }
  return result;
}

}  // namespace nilio::core
