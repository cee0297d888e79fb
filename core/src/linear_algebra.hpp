#pragma once

#include "nilio/core/se3.hpp"

namespace nilio::core {

// Decompositions, compiled once: each costs seconds of compile time wherever it is instantiated.

/// Solves A x = b for a symmetric, positive semi-definite A (LDLT).
Vector6 solve_ldlt(const Matrix6& A, const Vector6& b);
/// Inverse of a symmetric, positive definite A (LDLT).
Matrix6 inverse_ldlt(const Matrix6& A);
/// Solves A X = B (LU with partial pivoting).
Matrix6 solve_lu(const Matrix6& A, const Matrix6& B);
Vector12 solve_ldlt(const Matrix12& A, const Vector12& b);
Matrix12 inverse_ldlt(const Matrix12& A);
Matrix12 solve_lu(const Matrix12& A, const Matrix12& B);
/// (P + H^-1)^-1 = (I + H P)^-1 H for an information H and a covariance P: needs neither inverse.
Matrix6 information_with(const Matrix6& covariance, const Matrix6& information);
/// Inverse of A (LU with partial pivoting).
Matrix6 inverse_lu(const Matrix6& A);

/// Eigenvalues in ascending order and the eigenvectors in the columns.
struct SymmetricEigen6 {
  Vector6 values;
  Matrix6 vectors;
};
SymmetricEigen6 symmetric_eigen(const Matrix6& A);

/// The same of a 3x3 matrix, by a closed form without trigonometric functions: 0.1 us, and the same bits on
/// every processor. Errors of eigenvalues are below 1e-14 times the largest one.
struct SymmetricEigen3 {
  Vector3 values;
  Matrix3 vectors;
};
SymmetricEigen3 symmetric_eigen(const Matrix3& A);

}  // namespace nilio::core
