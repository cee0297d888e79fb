#pragma once

#include "nilio/core/se3.hpp"

namespace nilio::core {

// Decompositions of 6x6 matrices, compiled once: each costs seconds of compile time wherever it is
// instantiated.

/// Solves A x = b for a symmetric, positive semi-definite A (LDLT).
Vector6 solve_ldlt(const Matrix6& A, const Vector6& b);
/// Inverse of a symmetric, positive definite A (LDLT).
Matrix6 inverse_ldlt(const Matrix6& A);
/// Solves A X = B (LU with partial pivoting).
Matrix6 solve_lu(const Matrix6& A, const Matrix6& B);
/// Inverse of A (LU with partial pivoting).
Matrix6 inverse_lu(const Matrix6& A);

/// Eigenvalues in ascending order and the eigenvectors in the columns.
struct SymmetricEigen6 {
  Vector6 values;
  Matrix6 vectors;
};
SymmetricEigen6 symmetric_eigen(const Matrix6& A);

}  // namespace nilio::core
