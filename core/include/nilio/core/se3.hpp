#pragma once

#include <array>

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace nilio::core {

using Vector3 = Eigen::Vector3d;
using Matrix3 = Eigen::Matrix3d;
using Vector6 = Eigen::Matrix<double, 6, 1>;
using Matrix6 = Eigen::Matrix<double, 6, 6>;
using Vector12 = Eigen::Matrix<double, 12, 1>;
using Matrix12 = Eigen::Matrix<double, 12, 12>;

/// Rigid transform. `T_target_source * p_source = p_target`. Translation in metres.
struct SE3 {
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Vector3 translation = Vector3::Zero();

  static SE3 identity() { return {}; }
  [[nodiscard]] SE3 inverse() const;
  [[nodiscard]] Eigen::Matrix4d matrix() const;
  [[nodiscard]] bool is_finite() const { return rotation.coeffs().allFinite() && translation.allFinite(); }

  /// The rotation of the product is normalised, so long chains stay on the group.
  friend SE3 operator*(const SE3& a, const SE3& b) {
    return {(a.rotation * b.rotation).normalized(), a.rotation * b.translation + a.translation};
  }
  friend Vector3 operator*(const SE3& a, const Vector3& p) { return a.rotation * p + a.translation; }
};

/// Order of a quaternion in messages and files; Eigen's constructor begins with w.
inline std::array<double, 4> xyzw(const Eigen::Quaterniond& q) { return {q.x(), q.y(), q.z(), q.w()}; }
inline Eigen::Quaterniond from_xyzw(const std::array<double, 4>& q) { return {q[3], q[0], q[1], q[2]}; }

/// Skew-symmetric matrix: skew(a) * b = a x b.
Matrix3 skew(const Vector3& a);

/// Rotation vector (rad) to unit quaternion, and back (angle in [0, pi]).
Eigen::Quaterniond so3_exp(const Vector3& rotation_vector);
/// Rotation half-way between two that are less than half a turn apart.
Eigen::Quaterniond so3_mean(const Eigen::Quaterniond& a, const Eigen::Quaterniond& b);
Vector3 so3_log(const Eigen::Quaterniond& rotation);

/// Exponential and logarithm of SE(3). Order of the six components: translation part, then rotation part
/// (rad), as ROS orders covariances.
SE3 se3_exp(const Vector6& twist);
Vector6 se3_log(const SE3& transform);

/// Turns both halves of a six-vector: as a covariance of such is turned into other axes, B * C * B^T.
Matrix6 block_rotation(const Matrix3& R);
/// Adjoint: exp(adjoint(T) * e) = T * exp(e) * T^-1; transforms a small motion into the axes of the target.
Matrix6 adjoint(const SE3& T);

/// Builds a transform from a row-major 3x4 or 4x4 matrix (first 12 numbers); the rotation is projected onto
/// SO(3).
SE3 se3_from_matrix(const Eigen::Matrix<double, 3, 4>& matrix);

}  // namespace nilio::core
