#include "core/src/linear_algebra.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>

namespace nilio::core {

Vector6 solve_ldlt(const Matrix6& A, const Vector6& b) { return A.ldlt().solve(b); }

Matrix6 inverse_ldlt(const Matrix6& A) { return A.ldlt().solve(Matrix6::Identity()); }

Matrix6 solve_lu(const Matrix6& A, const Matrix6& B) { return A.partialPivLu().solve(B); }

Matrix6 inverse_lu(const Matrix6& A) { return A.inverse(); }

SymmetricEigen6 symmetric_eigen(const Matrix6& A) {
  const Eigen::SelfAdjointEigenSolver<Matrix6> solver(A);
  return {solver.eigenvalues(), solver.eigenvectors()};
}

}  // namespace nilio::core
