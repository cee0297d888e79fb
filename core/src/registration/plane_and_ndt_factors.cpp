#include "nilio/core/portable_math.hpp"

#include "core/src/registration/gauss_newton.hpp"
#include "core/src/registration/point_sums.hpp"

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

/// Share of the newest scan in a mean that follows the scans of a voxel.
double share_of_newest(const GaussianVoxel& surface) { return 2.0 / (surface.scans + 1.0); }

// Parts of a sweep with one covariance of the guess each.
constexpr std::size_t kSweepParts = 8;

/// Points of a sweep while its twist changes.
class MovingPoints {
 public:
  MovingPoints(std::span<const Eigen::Vector3f> points, const SweepChange& change, const PlaneMetric& metric,
               const Matrix6& D)
      : points_(points), change_(change) {
    covariance_[0] = D * metric.guess_covariance * D.transpose();
    if (change.problem == nullptr) return;
    for (const float time_s : change.problem->times_s)
      latest_s_ = std::max(latest_s_, std::abs(static_cast<double>(time_s)));
    const Matrix12& P = change.problem->prior.covariance;
    const Matrix6 cross = P.topRightCorner<6, 6>() + P.bottomLeftCorner<6, 6>();
    for (std::size_t i = 0; i < kSweepParts; ++i) {
      const double t = latest_s_ * (2.0 * (static_cast<double>(i) + 0.5) / kSweepParts - 1.0);
      const Matrix6 at_time = P.topLeftCorner<6, 6>() + t * cross + t * t * P.bottomRightCorner<6, 6>();
      covariance_[i] = D * at_time * D.transpose();
    }
  }

  [[nodiscard]] bool have_twist() const { return change_.problem != nullptr; }
  [[nodiscard]] double time_s(std::size_t i) const {
    return have_twist() ? static_cast<double>(change_.problem->times_s[i]) : 0.0;
  }
  [[nodiscard]] Vector3 operator[](std::size_t i) const {
    const Vector3 p = points_[i].cast<double>();
    if (!have_twist()) return p;
    return p + time_s(i) * (change_.twist.head<3>() + change_.twist.tail<3>().cross(p));
  }
  [[nodiscard]] const Matrix6& guess_covariance(std::size_t i) const {
    if (!(latest_s_ > 0.0)) return covariance_[0];
    const double share = 0.5 * (1.0 + time_s(i) / latest_s_);
    return covariance_[std::min(static_cast<std::size_t>(share * kSweepParts), kSweepParts - 1)];
  }

 private:
  std::span<const Eigen::Vector3f> points_;
  SweepChange change_;
  double latest_s_ = 0.0;
  std::array<Matrix6, kSweepParts> covariance_;
};

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

/// Squared error of a plane's normal, rad^2: noise, and the error that all points of a beam share.
double normal_variance(const GaussianVoxel& surface) {
  const double thickness = std::max(static_cast<double>(surface.thickness), 1e-12);
  const double spread = thickness / static_cast<double>(surface.planarity);
  return (thickness / surface.count + kScanErrorMetres * kScanErrorMetres) / spread;
}

/// Adds the residual vector of a point at `error` from the mean of a non-planar voxel. The weight along each
/// axis of its Gaussian is that of a plane of that thickness, and zero where the points fill the voxel
/// evenly: correspondences are voxels, so along such an axis the mean carries no information. Returns the
/// equivalent squared residual, m^2.
double add_gaussian(const GaussianVoxel& surface, const Vector3& error, const Vector3& q, double time_s,
                    double voxel_size_m, const PlaneMetric& metric, const Matrix6& guess_covariance,
                    PointSums& sums) {
  const double point_variance = metric.point_deviation_m * metric.point_deviation_m;
  // Thinness along an axis with the variance v: t = A / (1 + A), A = point_variance / v. Its excess over
  // that of an evenly filled voxel, f, is weighted: (t - f)^2 / (t + f), as one fraction.
  const double f = point_variance / (point_variance + voxel_size_m * voxel_size_m / 12.0);
  const Matrix3 A = point_variance * information_of(surface);
  const Matrix3 A_square = A * A;
  const Matrix3 one = Matrix3::Identity();
  const Matrix3 numerator = (1.0 - f) * (1.0 - f) * A_square - 2.0 * f * (1.0 - f) * A + f * f * one;
  const Matrix3 denominator = (1.0 + f) * A_square + (1.0 + 2.0 * f) * A + f * one;
  const Matrix3 weights = numerator * denominator.inverse();
  Vector6 gradient;
  gradient.head<3>() = weights * error;
  gradient.tail<3>() = q.cross(gradient.head<3>());
  const double square = error.dot(gradient.head<3>());
  const double length_square = gradient.head<3>().squaredNorm();
  const double guess_variance =
      length_square > 0.0 ? gradient.dot(guess_covariance * gradient) / length_square : 0.0;
  const double scale_square = metric.kernel_square(guess_variance);
  const double root = scale_square / (scale_square + square);
  const double weight = metric.gaussian_weight * root * root * familiarity(surface);
  sums.add(packed_information(weights, q), gradient, weight, share_of_newest(surface), time_s);
  sums.weighted_square_error += weight * square;
  sums.weight_sum += weight * weights.trace();
  sums.gaussian_square_excess += weight * (square - weights.trace() * point_variance);
  return square;
}

}  // namespace

NormalEquations plane_equations(const VoxelMap& map, std::span<const Eigen::Vector3f> points,
                                const SE3& T_map_moving, const PlaneMetric& metric,
                                const SweepChange& change) {
  const Matrix3 R = T_map_moving.rotation.toRotationMatrix();
  const Vector3 t = T_map_moving.translation;
  const MovingPoints moving(points, change, metric, block_rotation(R));
  const double point_variance = metric.point_deviation_m * metric.point_deviation_m;
  const double inlier_square = metric.inlier_distance_m * metric.inlier_distance_m;
  const auto max_planarity = static_cast<float>(metric.max_planarity);
  const PointSums total = sum_points(points, [&](const Eigen::Vector3f& point, PointSums& sums) {
    const auto i = static_cast<std::size_t>(&point - points.data());
    const Vector3 q = R * moving[i];
    const VoxelIndex index = map.index_of(q + t);
    const GaussianVoxel* surface = map.find(index);
    if (surface == nullptr || !surface->has_shape()) return;
    const Vector3 offset = q + t - map.corner_of(index) - surface->mean.cast<double>();
    if (surface->planarity > max_planarity) {
      const double square = add_gaussian(*surface, offset, q, moving.time_s(i), map.config().voxel_size_m,
                                         metric, moving.guess_covariance(i), sums);
      sums.agreement += agreement_of(square / (3.0 * point_variance));
      ++sums.correspondences;
      if (square < inlier_square) ++sums.inliers;
      return;
    }
    const Vector3 normal = surface->normal.cast<double>();
    const double residual = normal.dot(offset);
    Vector6 J;
    J << normal, q.cross(normal);
    const double guess_variance = J.dot(moving.guess_covariance(i) * J);
    if (residual * residual > metric.gate_square(guess_variance)) return;
    const double scale_square = metric.kernel_square(guess_variance);
    const double root = scale_square / (scale_square + residual * residual);
    const double certainty = plane_weight(*surface, offset - residual * normal, point_variance);
    const double weight = root * root * familiarity(*surface) * certainty;
    sums.agreement += agreement_of(certainty * residual * residual / point_variance);
    const PackedMatrix6 information = packed_square(J);
    sums.add(information, residual * J, weight, share_of_newest(*surface), moving.time_s(i));
    // A normal with the variance v across it is expected to add v (E^T E - J^T J), E = [I, -skew(q)].
    sums.H_normals += weight * normal_variance(*surface) * (packed_unit_information(q) - information);
    sums.weighted_square_error += weight * residual * residual;
    sums.weight_sum += weight;
    ++sums.correspondences;
    if (std::abs(residual) < metric.inlier_distance_m) ++sums.inliers;
  });
  return total.in_moving_axes(R);
}

NormalEquations ndt_equations(const VoxelMap& map, std::span<const Eigen::Vector3f> points,
                              const SE3& T_map_moving, const NdtMetric& metric) {
  static const std::array<VoxelIndex, 7> kNeighbours = {
      VoxelIndex(0, 0, 0),  VoxelIndex(1, 0, 0), VoxelIndex(-1, 0, 0), VoxelIndex(0, 1, 0),
      VoxelIndex(0, -1, 0), VoxelIndex(0, 0, 1), VoxelIndex(0, 0, -1)};
  const Matrix3 R = T_map_moving.rotation.toRotationMatrix();
  const Vector3 t = T_map_moving.translation;
  const double exponent = -0.5 / (metric.kernel_scale * metric.kernel_scale);
  const PointSums total = sum_points(points, [&](const Eigen::Vector3f& point, PointSums& sums) {
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
      sums.weighted_square_error += weight * square_distance;
      sums.weight_sum += weight;
      matched = true;
    }
    if (!matched) return;
    ++sums.correspondences;
    sums.H += packed_information(information_sum, q);
    sums.b.head<3>() += gradient;
    sums.b.tail<3>() += q.cross(gradient);
  });
  return total.in_moving_axes(R);
}

}  // namespace nilio::core
