#include "core/src/map/map_drift.hpp"

namespace nilio::core {

namespace {

Matrix6 transformed(const Matrix6& A, const Matrix6& covariance) { return A * covariance * A.transpose(); }

}  // namespace

void MapDrift::take(const SE3& T_map_base, const Matrix6& covariance) {
  pose_ = transformed(adjoint(T_map_base), covariance);
  has_taken_ = true;
}

void MapDrift::follow(const SE3& T_map_base, const Matrix6& share, const Matrix6& gain) {
  const Matrix6 to_map = adjoint(T_map_base);
  const Matrix6 to_base = adjoint(T_map_base.inverse());
  const Matrix6 A = to_map * (has_taken_ ? share : Matrix6::Zero()) * to_base;
  const Matrix6 moved = correlation_ + A * pose_;
  covariance_ += A * correlation_.transpose() + moved * A.transpose();
  const Matrix6 I = Matrix6::Identity();
  correlation_ = moved * (to_map * (I - gain) * to_base * (I - A)).transpose();
  has_taken_ = false;
}

Matrix6 MapDrift::at(const SE3& T_map_base) const {
  return transformed(adjoint(T_map_base.inverse()), covariance_);
}

}  // namespace nilio::core
