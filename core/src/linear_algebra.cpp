#include "core/src/linear_algebra.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <Eigen/LU>

namespace nilio::core {

namespace {

constexpr double kCosine30Deg = 0.5 * std::numbers::sqrt3;

}  // namespace

Vector6 solve_ldlt(const Matrix6& A, const Vector6& b) { return A.ldlt().solve(b); }

Matrix6 inverse_ldlt(const Matrix6& A) { return A.ldlt().solve(Matrix6::Identity()); }

Matrix6 solve_lu(const Matrix6& A, const Matrix6& B) { return A.partialPivLu().solve(B); }

Vector12 solve_ldlt(const Matrix12& A, const Vector12& b) { return A.ldlt().solve(b); }

Matrix12 inverse_ldlt(const Matrix12& A) { return A.ldlt().solve(Matrix12::Identity()); }

Matrix12 solve_lu(const Matrix12& A, const Matrix12& B) { return A.partialPivLu().solve(B); }

Matrix6 information_with(const Matrix6& covariance, const Matrix6& information) {
  return solve_lu(Matrix6(Matrix6::Identity() + information * covariance), information);
}

Matrix6 inverse_lu(const Matrix6& A) { return A.inverse(); }

SymmetricEigen6 symmetric_eigen(const Matrix6& A) {
  const Eigen::SelfAdjointEigenSolver<Matrix6> solver(A);
  return {solver.eigenvalues(), solver.eigenvectors()};
}

namespace {

/// cos(acos(x) / 3) for x in [0, 1]: the root of 4 c^3 - 3 c = x near 1, by Newton's method.
double cosine_of_third(double x) {
  double c = kCosine30Deg + x * (1.0 / 6.0 - (kCosine30Deg - 5.0 / 6.0) * x);
  for (int i = 0; i < 3; ++i) c -= (c * (4.0 * c * c - 3.0) - x) / (12.0 * c * c - 3.0);
  return c;
}

/// Direction of the eigenvector of a simple eigenvalue: orthogonal to the rows of B - value I.
Vector3 eigenvector_of(const Matrix3& B, double value) {
  const Matrix3 rows = B - value * Matrix3::Identity();
  const Vector3 a = rows.row(0).cross(rows.row(1));
  const Vector3 b = rows.row(0).cross(rows.row(2));
  const Vector3 c = rows.row(1).cross(rows.row(2));
  const double a2 = a.squaredNorm();
  const double b2 = b.squaredNorm();
  const double c2 = c.squaredNorm();
  if (a2 >= b2 && a2 >= c2) return a / std::sqrt(a2);
  return b2 >= c2 ? Vector3(b / std::sqrt(b2)) : Vector3(c / std::sqrt(c2));
}

}  // namespace

SymmetricEigen3 symmetric_eigen(const Matrix3& A) {
  const double mean = A.trace() / 3.0;
  const Matrix3 centred = A - mean * Matrix3::Identity();
  const double scale = std::sqrt(centred.squaredNorm() / 6.0);
  if (!(scale > 0.0)) return {Vector3::Constant(mean), Matrix3::Identity()};
  // The eigenvalues of B are 2 cos(phi), 2 cos(phi +- 120 deg) with cos(3 phi) = det(B) / 2. The one that is
  // farthest from zero is simple; the others follow from the plane orthogonal to its eigenvector.
  const Matrix3 B = centred / scale;
  const double cosine = 0.5 * B.determinant();
  const bool is_largest = cosine >= 0.0;
  const double isolated = (is_largest ? 2.0 : -2.0) * cosine_of_third(std::min(std::abs(cosine), 1.0));
  const Vector3 v = eigenvector_of(B, isolated);
  const Vector3 u = v.unitOrthogonal();
  const Vector3 w = v.cross(u);
  const Vector3 Bw = B * w;
  const double uu = u.dot(B * u);
  const double uw = u.dot(Bw);
  const double ww = w.dot(Bw);
  // Rotation of u and w that makes uw vanish (Jacobi).
  const double ratio = uw == 0.0 ? 0.0 : (ww - uu) / (2.0 * uw);
  const double tangent =
      uw == 0.0 ? 0.0 : (ratio < 0.0 ? -1.0 : 1.0) / (std::abs(ratio) + std::sqrt(ratio * ratio + 1.0));
  const double c = 1.0 / std::sqrt(tangent * tangent + 1.0);
  const double s = tangent * c;
  double lower = uu - tangent * uw;
  double upper = ww + tangent * uw;
  Vector3 lower_vector = c * u - s * w;
  Vector3 upper_vector = s * u + c * w;
  if (upper < lower) {
    std::swap(lower, upper);
    lower_vector.swap(upper_vector);
  }
  SymmetricEigen3 result;
  if (is_largest) {
    result.values << lower, upper, isolated;
    result.vectors << lower_vector, upper_vector, v;
  } else {
    result.values << isolated, lower, upper;
    result.vectors << v, lower_vector, upper_vector;
  }
  result.values = (scale * result.values).array() + mean;
  return result;
}

}  // namespace nilio::core
