#include "nilio/core/se3.hpp"

#include <random>

#include <catch2/catch.hpp>

using namespace nilio::core;

TEST_CASE("the logarithm undoes the exponential for small, large and nearly half-turn rotations", "[se3]") {
  std::mt19937_64 generator(7);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  for (const double angle : {0.0, 1e-9, 1e-6, 1e-4, 1e-3, 0.1, 1.0, 3.0, 3.14}) {
    Vector6 twist;
    for (int i = 0; i < 6; ++i) twist[i] = uniform(generator);
    twist.tail<3>() = twist.tail<3>().normalized() * angle;
    const Vector6 back = se3_log(se3_exp(twist));
    CAPTURE(angle);
    CHECK((back - twist).norm() < 1e-7);
  }
}

TEST_CASE("the mean of two rotations is half-way along the shorter arc", "[se3]") {
  std::mt19937_64 generator(8);
  std::normal_distribution<double> normal;
  for (int i = 0; i < 200; ++i) {
    const Eigen::Quaterniond a = so3_exp(Vector3(normal(generator), normal(generator), normal(generator)));
    const Eigen::Quaterniond b = so3_exp(Vector3(normal(generator), normal(generator), normal(generator)));
    const Eigen::Quaterniond mean = so3_mean(a, b);
    CHECK((so3_log(a.conjugate() * mean) - 0.5 * so3_log(a.conjugate() * b)).norm() < 1e-13);
    CHECK(mean.norm() == Approx(1.0).margin(1e-15));
  }
}

TEST_CASE("a transform times its inverse is the identity", "[se3]") {
  Vector6 twist;
  twist << 3.0, -2.0, 1.0, 0.4, -0.7, 1.9;
  const SE3 product = se3_exp(twist) * se3_exp(twist).inverse();
  CHECK(product.translation.norm() < 1e-12);
  CHECK(so3_log(product.rotation).norm() < 1e-12);
}

TEST_CASE("the exponential of a screw is the motion of a point on it", "[se3]") {
  // A quarter turn about z while moving on a circle of radius 2: ends at (2, 2).
  Vector6 twist;
  twist << 2.0 * M_PI / 2.0, 0.0, 0.0, 0.0, 0.0, M_PI / 2.0;
  const SE3 motion = se3_exp(twist);
  CHECK((motion.translation - Vector3(2.0, 2.0, 0.0)).norm() < 1e-12);
}

TEST_CASE("a matrix that is not quite a rotation is projected onto one", "[se3]") {
  Eigen::Matrix<double, 3, 4> matrix;
  matrix << 0.0, -1.001, 0.0, 1.0, 0.999, 0.0, 0.0, 2.0, 0.0, 0.0, 1.0, 3.0;
  const SE3 transform = se3_from_matrix(matrix);
  CHECK(transform.rotation.norm() == Approx(1.0).margin(1e-15));
  CHECK((transform * Vector3(1.0, 0.0, 0.0) - Vector3(1.0, 3.0, 3.0)).norm() < 2e-3);
}

TEST_CASE("the adjoint moves a small motion to the other side of a transform", "[se3]") {
  Vector6 twist;
  twist << 3.0, -2.0, 1.0, 0.4, -0.7, 1.9;
  const SE3 T = se3_exp(twist);
  Vector6 small;
  small << 0.01, -0.02, 0.03, 0.004, 0.002, -0.001;
  const SE3 difference = se3_exp(adjoint(T) * small).inverse() * (T * se3_exp(small) * T.inverse());
  CHECK(difference.translation.norm() < 1e-12);
  CHECK(so3_log(difference.rotation).norm() < 1e-12);
}

TEST_CASE("a quaternion in the order of messages comes back", "[se3]") {
  const Eigen::Quaterniond q = so3_exp({0.3, -0.2, 0.9});
  CHECK(from_xyzw(xyzw(q)).coeffs() == q.coeffs());
}
