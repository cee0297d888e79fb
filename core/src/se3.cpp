#include "nilio/core/se3.hpp"

#include "nilio/core/portable_math.hpp"

#include <Eigen/SVD>

namespace nilio::core {

namespace {

// Below this angle (rad) the series is exact to double precision and the closed form is not.
constexpr double kSmallAngle = 1e-5;

}  // namespace

SE3 SE3::inverse() const {
  const Eigen::Quaterniond inverse_rotation = rotation.conjugate();
  return {inverse_rotation, -(inverse_rotation * translation)};
}

Eigen::Matrix4d SE3::matrix() const {
  Eigen::Matrix4d m = Eigen::Matrix4d::Identity();
  m.topLeftCorner<3, 3>() = rotation.toRotationMatrix();
  m.topRightCorner<3, 1>() = translation;
  return m;
}

Matrix3 skew(const Vector3& a) {
  Matrix3 m;
  m << 0.0, -a.z(), a.y(), a.z(), 0.0, -a.x(), -a.y(), a.x(), 0.0;
  return m;
}

Eigen::Quaterniond so3_exp(const Vector3& rotation_vector) {
  const double angle = rotation_vector.norm();
  const double half_sinc =
      angle < kSmallAngle ? 0.5 - angle * angle / 48.0 : portable::sin(0.5 * angle) / angle;
  const Vector3 v = half_sinc * rotation_vector;
  return Eigen::Quaterniond(portable::cos(0.5 * angle), v.x(), v.y(), v.z()).normalized();
}

Eigen::Quaterniond so3_mean(const Eigen::Quaterniond& a, const Eigen::Quaterniond& b) {
  const double sign = a.dot(b) < 0.0 ? -1.0 : 1.0;
  return Eigen::Quaterniond(a.coeffs() + sign * b.coeffs()).normalized();
}

Vector3 so3_log(const Eigen::Quaterniond& rotation) {
  // The quaternion and its negative are the same rotation; take the one with the shorter way round.
  const double sign = rotation.w() < 0.0 ? -1.0 : 1.0;
  const Vector3 v = sign * rotation.vec();
  const double sine = v.norm();
  const double angle = 2.0 * portable::atan2(sine, sign * rotation.w());
  return (sine < kSmallAngle ? 2.0 : angle / sine) * v;
}

SE3 se3_exp(const Vector6& twist) {
  const Vector3 rho = twist.head<3>();
  const Vector3 phi = twist.tail<3>();
  const double angle = phi.norm();
  const Matrix3 phi_hat = skew(phi);
  double a = 0.5;
  double b = 1.0 / 6.0;
  if (angle >= kSmallAngle) {
    a = (1.0 - portable::cos(angle)) / (angle * angle);
    b = (angle - portable::sin(angle)) / (angle * angle * angle);
  }
  return {so3_exp(phi), rho + a * (phi_hat * rho) + b * (phi_hat * (phi_hat * rho))};
}

Vector6 se3_log(const SE3& transform) {
  const Vector3 phi = so3_log(transform.rotation);
  const double angle = phi.norm();
  const Matrix3 phi_hat = skew(phi);
  double c = 1.0 / 12.0;
  if (angle >= 1e-3) {
    c = 1.0 / (angle * angle) - (1.0 + portable::cos(angle)) / (2.0 * angle * portable::sin(angle));
  }
  const Vector3 t = transform.translation;
  Vector6 twist;
  twist.head<3>() = t - 0.5 * (phi_hat * t) + c * (phi_hat * (phi_hat * t));
  twist.tail<3>() = phi;
  return twist;
}

Matrix6 block_rotation(const Matrix3& R) {
  Matrix6 blocks = Matrix6::Zero();
  blocks.topLeftCorner<3, 3>() = R;
  blocks.bottomRightCorner<3, 3>() = R;
  return blocks;
}

Matrix6 adjoint(const SE3& T) {
  const Matrix3 R = T.rotation.toRotationMatrix();
  Matrix6 result = block_rotation(R);
  result.topRightCorner<3, 3>() = skew(T.translation) * R;
  return result;
}

SE3 se3_from_matrix(const Eigen::Matrix<double, 3, 4>& matrix) {
  const Matrix3 raw = matrix.leftCols<3>();
  const Eigen::JacobiSVD<Matrix3> svd(raw, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Matrix3 sign = Matrix3::Identity();
  sign(2, 2) = (svd.matrixU() * svd.matrixV().transpose()).determinant() < 0.0 ? -1.0 : 1.0;
  const Matrix3 rotation = svd.matrixU() * sign * svd.matrixV().transpose();
  return {Eigen::Quaterniond(rotation).normalized(), matrix.col(3)};
}

}  // namespace nilio::core
