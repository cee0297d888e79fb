#include "core/src/linear_algebra.hpp"

#include <random>

#include <Eigen/Eigenvalues>
#include <catch2/catch.hpp>

using namespace nilio::core;

namespace {

/// Of a matrix with these eigenvalues about random axes.
void check_decomposition(const Vector3& values, std::mt19937_64& generator) {
  std::normal_distribution<double> normal;
  const Eigen::Quaterniond axes =
      Eigen::Quaterniond(normal(generator), normal(generator), normal(generator), normal(generator))
          .normalized();
  const Matrix3 R = axes.toRotationMatrix();
  const Matrix3 half = R * values.asDiagonal() * R.transpose();
  const Matrix3 A = 0.5 * (half + half.transpose());
  const SymmetricEigen3 eigen = symmetric_eigen(A);
  const double scale = values.cwiseAbs().maxCoeff();
  CAPTURE(values.transpose(), axes.coeffs().transpose());
  const Eigen::SelfAdjointEigenSolver<Matrix3> reference(A);
  CHECK((eigen.values - reference.eigenvalues()).cwiseAbs().maxCoeff() <= 1e-14 * scale);
  CHECK((eigen.vectors.transpose() * eigen.vectors - Matrix3::Identity()).norm() < 1e-14);
  CHECK((A * eigen.vectors - eigen.vectors * eigen.values.asDiagonal()).norm() <= 2e-14 * scale);
}

}  // namespace

TEST_CASE("3x3 eigenvalues and eigenvectors agree with an iterative solver", "[linear_algebra]") {
  std::mt19937_64 generator(5);
  std::uniform_real_distribution<double> exponent(-9.0, 2.0);
  for (int i = 0; i < 2000; ++i)
    check_decomposition({std::pow(10.0, exponent(generator)), std::pow(10.0, exponent(generator)),
                         std::pow(10.0, exponent(generator))},
                        generator);
}

TEST_CASE("3x3 eigenvectors stay orthonormal where eigenvalues are equal or negative", "[linear_algebra]") {
  std::mt19937_64 generator(6);
  for (const Vector3& values :
       {Vector3(1.0, 1.0, 1.0), Vector3(0.0, 1.0, 1.0), Vector3(0.0, 0.0, 1.0), Vector3(-1.0, 0.0, 1.0),
        Vector3(1.0, 1.0, 1.0 + 1e-12), Vector3(1e-12, 1.0, 1.0 + 1e-9), Vector3(-2.0, -1.0, -1.0)})
    for (int i = 0; i < 50; ++i) check_decomposition(values, generator);
}

TEST_CASE("a 3x3 multiple of the identity keeps its axes", "[linear_algebra]") {
  for (const double value : {0.0, 2.5, -1.0}) {
    const SymmetricEigen3 eigen = symmetric_eigen(Matrix3(value * Matrix3::Identity()));
    CHECK(eigen.values == Vector3::Constant(value));
    CHECK(eigen.vectors == Matrix3::Identity());
  }
}
