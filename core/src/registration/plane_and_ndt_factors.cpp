#include "nilio/core/portable_math.hpp"

#include "core/src/registration/gauss_newton.hpp"
#include "core/src/registration/registration.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace nilio::core {

namespace {

// Lower bound: few points underestimate the thickness.
constexpr double kMinPlaneVariance = 0.01 * 0.01;
// Scans from which a voxel has its full weight: moving objects leave a voxel sooner.
constexpr int kFamiliarScans = 6;

/// Weight of a voxel by the number of scans that saw it, 0 to 1.
double familiarity(const GaussianVoxel& surface) {
  return std::min<int>(surface.scans, kFamiliarScans) / double{kFamiliarScans};
}

Matrix3 information_of(const GaussianVoxel& surface) {
  const float* packed = surface.information;
  Matrix3 information;
  information << packed[0], packed[1], packed[2], packed[1], packed[3], packed[4], packed[2], packed[4],
      packed[5];
  return information;
}

/// Weight of a point at `offset` from the plane's mean, 1 for a perfectly known plane. The error of the
/// normal grows with the square of the distance in units of the points' spread.
double plane_weight(const GaussianVoxel& surface, const Vector3& offset, double point_variance) {
  const float* packed = surface.information;
  const double square_distance =
      offset.x() * (packed[0] * offset.x() + 2.0 * (packed[1] * offset.y() + packed[2] * offset.z())) +
      offset.y() * (packed[3] * offset.y() + 2.0 * packed[4] * offset.z()) +
      offset.z() * packed[5] * offset.z();
  const double thickness = std::max(static_cast<double>(surface.thickness), kMinPlaneVariance);
  return point_variance / (point_variance + thickness * (1.0 + square_distance));
}

/// Agreement of a point whose squared residual is `normalised_square` times its variance.
double agreement_of(double normalised_square) {
  const double root = 1.0 / (1.0 + normalised_square);
  return root * root;
}

/// Adds a point at `q` (map axes, from the origin of the moving frame) with Jacobian [I, -skew(q)];
/// `information` and `gradient` are weighted.
void add_point(const Matrix3& information, const Vector3& gradient, const Vector3& q,
               NormalEquations& equations) {
  const Matrix3 S = skew(q);
  const Matrix3 cross = information * S;
  equations.H.topLeftCorner<3, 3>() += information;
  equations.H.topRightCorner<3, 3>() -= cross;
  equations.H.bottomRightCorner<3, 3>() += S.transpose() * cross;
  equations.b.head<3>() += gradient;
  equations.b.tail<3>() += q.cross(gradient);
}

/// Adds the residual vector of a point at `error` from the mean of a non-planar voxel. The weight along each
/// axis of its Gaussian is that of a plane of that thickness, and zero where the points fill the voxel
/// evenly: correspondences are voxels, so along such an axis the mean carries no information. Returns the
/// equivalent squared residual, m^2.
double add_gaussian(const GaussianVoxel& surface, const Vector3& error, const Vector3& q, double voxel_size_m,
                    const PlaneMetric& metric, const Matrix6& guess_covariance, NormalEquations& equations) {
  const double point_variance = metric.point_deviation_m * metric.point_deviation_m;
  const Matrix3 information = information_of(surface);
  const Matrix3 thinness =
      point_variance * information * (Matrix3::Identity() + point_variance * information).inverse();
  const double evenly_filled = point_variance / (point_variance + voxel_size_m * voxel_size_m / 12.0);
  const Matrix3 full = evenly_filled * Matrix3::Identity();
  const Matrix3 excess = thinness - full;
  const Matrix3 weights = excess * excess * (thinness + full).inverse();
  const Vector3 gradient = weights * error;
  const double square = error.dot(gradient);
  Vector6 J = Vector6::Zero();
  const double length = gradient.norm();
  if (length > 0.0) J << gradient / length, q.cross(gradient) / length;
  const double scale_square = metric.kernel_square(J.dot(guess_covariance * J));
  const double root = scale_square / (scale_square + square);
  const double weight = metric.gaussian_weight * root * root * familiarity(surface);
  add_point(weight * weights, weight * gradient, q, equations);
  equations.weighted_square_error += weight * square;
  equations.weight_sum += weight * weights.trace();
  equations.gaussian_square_excess += weight * (square - weights.trace() * point_variance);
  return square;
}

void add_upper(Matrix6& H, const Vector6& J, double weight) {
  for (int column = 0; column < 6; ++column) {
    const double weighted = weight * J[column];
    for (int row = 0; row <= column; ++row) H(row, column) += J[row] * weighted;
  }
}

/// Converts equations of a motion in map axes to the axes of the moving frame.
NormalEquations in_moving_axes(NormalEquations equations, const Matrix3& R_map_moving) {
  const Matrix6 D = block_rotation(R_map_moving);
  equations.H = D.transpose() * equations.H * D;
  equations.b = D.transpose() * equations.b;
  return equations;
}

}  // namespace

NormalEquations plane_equations(const VoxelMap& map, std::span<const Eigen::Vector3f> points,
                                const SE3& T_map_moving, const PlaneMetric& metric) {
  const Matrix3 R = T_map_moving.rotation.toRotationMatrix();
  const Vector3 t = T_map_moving.translation;
  const Matrix6 D = block_rotation(R);
  const Matrix6 guess_covariance = D * metric.guess_covariance * D.transpose();
  const double point_variance = metric.point_deviation_m * metric.point_deviation_m;
  const double inlier_square = metric.inlier_distance_m * metric.inlier_distance_m;
  const auto max_planarity = static_cast<float>(metric.max_planarity);
  const NormalEquations sum =
      reduce_points(points, [&](const Eigen::Vector3f& point, NormalEquations& equations) {
        const Vector3 q = R * point.cast<double>();
        const VoxelIndex index = map.index_of(q + t);
        const GaussianVoxel* surface = map.find(index);
        if (surface == nullptr || !surface->has_shape()) return;
        const Vector3 offset = q + t - map.corner_of(index) - surface->mean.cast<double>();
        if (surface->planarity > max_planarity) {
          const double square = add_gaussian(*surface, offset, q, map.config().voxel_size_m, metric,
                                             guess_covariance, equations);
          equations.agreement += agreement_of(square / (3.0 * point_variance));
          ++equations.correspondences;
          if (square < inlier_square) ++equations.inliers;
          return;
        }
        const Vector3 normal = surface->normal.cast<double>();
        const double residual = normal.dot(offset);
        Vector6 J;
        J << normal, q.cross(normal);
        const double guess_variance = J.dot(guess_covariance * J);
        if (residual * residual > metric.gate_square(guess_variance)) return;
        const double scale_square = metric.kernel_square(guess_variance);
        const double root = scale_square / (scale_square + residual * residual);
        const double certainty = plane_weight(*surface, offset - residual * normal, point_variance);
        const double weight = root * root * familiarity(*surface) * certainty;
        equations.agreement += agreement_of(certainty * residual * residual / point_variance);
        add_upper(equations.H, J, weight);
        equations.b += (weight * residual) * J;
        equations.weighted_square_error += weight * residual * residual;
        equations.weight_sum += weight;
        equations.normal_square += weight * static_cast<double>(surface->planarity) / surface->count;
        ++equations.correspondences;
        if (std::abs(residual) < metric.inlier_distance_m) ++equations.inliers;
      });
  return in_moving_axes(sum, R);
}

NormalEquations ndt_equations(const VoxelMap& map, std::span<const Eigen::Vector3f> points,
                              const SE3& T_map_moving, const NdtMetric& metric) {
  static const std::array<VoxelIndex, 7> kNeighbours = {
      VoxelIndex(0, 0, 0),  VoxelIndex(1, 0, 0), VoxelIndex(-1, 0, 0), VoxelIndex(0, 1, 0),
      VoxelIndex(0, -1, 0), VoxelIndex(0, 0, 1), VoxelIndex(0, 0, -1)};
  const Matrix3 R = T_map_moving.rotation.toRotationMatrix();
  const Vector3 t = T_map_moving.translation;
  const double exponent = -0.5 / (metric.kernel_scale * metric.kernel_scale);
  const NormalEquations sum =
      reduce_points(points, [&](const Eigen::Vector3f& point, NormalEquations& equations) {
        const Vector3 q = R * point.cast<double>();
        const VoxelIndex home = map.index_of(q + t);
        std::array<VoxelIndex, 7> indices;
        for (std::size_t k = 0; k < indices.size(); ++k) indices[k] = home + kNeighbours[k];
        std::array<const GaussianVoxel*, 7> surfaces;
        map.find_all(indices, indices.size(), surfaces);
        Matrix3 information_sum = Matrix3::Zero();
        Vector3 gradient = Vector3::Zero();
        bool matched = false;
        for (std::size_t k = 0; k < indices.size(); ++k) {
          if (surfaces[k] == nullptr) continue;
          const Vector3 error = q + t - map.corner_of(indices[k]) - surfaces[k]->mean.cast<double>();
          const Matrix3 information = information_of(*surfaces[k]);
          const Vector3 weighted_error = information * error;
          const double square_distance = error.dot(weighted_error);
          const double weight = portable::exp(exponent * square_distance);
          information_sum += weight * information;
          gradient += weight * weighted_error;
          equations.weighted_square_error += weight * square_distance;
          equations.weight_sum += weight;
          matched = true;
        }
        if (!matched) return;
        ++equations.correspondences;
        add_point(information_sum, gradient, q, equations);
      });
  return in_moving_axes(sum, R);
}

}  // namespace nilio::core
