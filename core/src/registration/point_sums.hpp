#pragma once

#include "core/src/registration/registration.hpp"
#include "core/src/thread_sanitizer.hpp"

#include <cstddef>
#include <span>

#include <tbb/blocked_range.h>
#include <tbb/parallel_reduce.h>

namespace nilio::core {

/// Upper triangle of a symmetric 6 x 6 matrix, column by column, and a zero for an even number.
using PackedMatrix6 = Eigen::Matrix<double, 22, 1>;

/// J^T J for a row J.
inline PackedMatrix6 packed_square(const Vector6& J) {
  PackedMatrix6 packed;
  Eigen::Index entry = 0;
  for (Eigen::Index column = 0; column < 6; ++column)
    for (Eigen::Index row = 0; row <= column; ++row) packed[entry++] = J[row] * J[column];
  packed[entry] = 0.0;
  return packed;
}

/// E^T E for a point at `q` (map axes, from the origin of the moving frame) with Jacobian E = [I, -skew(q)].
inline PackedMatrix6 packed_unit_information(const Vector3& q) {
  const Vector3 squares = q.cwiseAbs2();
  PackedMatrix6 packed;
  packed << 1.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, -q.z(), q.y(), squares.y() + squares.z(), q.z(), 0.0, -q.x(),
      -q.x() * q.y(), squares.x() + squares.z(), -q.y(), q.x(), 0.0, -q.x() * q.z(), -q.y() * q.z(),
      squares.x() + squares.y(), 0.0;
  return packed;
}

/// E^T W E for the same point, with the information W of its residual.
inline PackedMatrix6 packed_information(const Matrix3& W, const Vector3& q) {
  Matrix3 cross;
  cross << q.y() * W.col(2) - q.z() * W.col(1), q.z() * W.col(0) - q.x() * W.col(2),
      q.x() * W.col(1) - q.y() * W.col(0);
  PackedMatrix6 packed;
  packed << W(0, 0), W.col(1).head<2>(), W.col(2), cross.col(0), q.cross(cross.col(0)).head<1>(),
      cross.col(1), q.cross(cross.col(1)).head<2>(), cross.col(2), q.cross(cross.col(2)), 0.0;
  return packed;
}

/// Normal equations of a motion in map axes while points are added; see NormalEquations.
struct PointSums : ResidualSums {
  PackedMatrix6 H = PackedMatrix6::Zero();
  PackedMatrix6 H_cross = PackedMatrix6::Zero();
  PackedMatrix6 H_twist = PackedMatrix6::Zero();
  PackedMatrix6 H_newest = PackedMatrix6::Zero();
  PackedMatrix6 H_normals = PackedMatrix6::Zero();

  PointSums& operator+=(const PointSums& other);

  /// Adds a point with the residual e at a time from the midpoint of the sweep; `information` is E^T W E,
  /// `gradient` E^T W e.
  void add(const PackedMatrix6& information, const Vector6& gradient, double weight, double share_of_newest,
           double time_s) {
    H += weight * information;
    H_newest += weight * share_of_newest * information;
    b += weight * gradient;
    if (time_s == 0.0) return;
    H_cross += weight * time_s * information;
    H_twist += weight * time_s * time_s * information;
    b_twist += weight * time_s * gradient;
  }

  /// The equations in axes of the moving frame.
  [[nodiscard]] NormalEquations in_moving_axes(const Matrix3& R_map_moving) const;
};

/// Sums `accumulate(point, sums)` over all points in a fixed order.
template <class Accumulate>
PointSums sum_points(std::span<const Eigen::Vector3f> points, const Accumulate& accumulate) {
  // Points per leaf of the reduction. Fixed, so that the tree and every rounding depend on the number of
  // points only.
  constexpr std::size_t grain = 512;
  using Range = tbb::blocked_range<std::size_t>;
  char order = 0;
  sanitizer_release(&order);
  const PointSums sum = tbb::parallel_deterministic_reduce(
      Range(0, points.size(), grain), PointSums{},
      [&](const Range& range, PointSums sums) {
        sanitizer_acquire(&order);
        for (std::size_t i = range.begin(); i < range.end(); ++i) accumulate(points[i], sums);
        sanitizer_release(&order);
        return sums;
      },
      [](PointSums a, const PointSums& b) { return a += b; });
  sanitizer_acquire(&order);
  return sum;
}

}  // namespace nilio::core
