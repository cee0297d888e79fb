#include "core/src/registration/point_sums.hpp"

namespace nilio::core {

namespace {

Matrix6 unpacked(const PackedMatrix6& packed) {
  Matrix6 H;
  Eigen::Index entry = 0;
  for (Eigen::Index column = 0; column < 6; ++column)
    for (Eigen::Index row = 0; row <= column; ++row) H(row, column) = H(column, row) = packed[entry++];
  return H;
}

}  // namespace

PointSums& PointSums::operator+=(const PointSums& other) {
  H += other.H;
  H_cross += other.H_cross;
  H_twist += other.H_twist;
  H_newest += other.H_newest;
  H_normals += other.H_normals;
  b += other.b;
  b_twist += other.b_twist;
  weighted_square_error += other.weighted_square_error;
  weight_sum += other.weight_sum;
  gaussian_square_excess += other.gaussian_square_excess;
  correspondences += other.correspondences;
  inliers += other.inliers;
  agreement += other.agreement;
  return *this;
}

NormalEquations PointSums::in_moving_axes(const Matrix3& R_map_moving) const {
  const Matrix6 D = block_rotation(R_map_moving);
  const auto turned = [&](const PackedMatrix6& matrix) -> Matrix6 {
    return D.transpose() * unpacked(matrix) * D;
  };
  NormalEquations equations{*this,           turned(H),        turned(H_cross),
                            turned(H_twist), turned(H_newest), turned(H_normals)};
  equations.b = D.transpose() * b;
  equations.b_twist = D.transpose() * b_twist;
  return equations;
}

}  // namespace nilio::core
