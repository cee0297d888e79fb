#include "tools/inspect/imu_calibration/axis_permutation.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/SVD>

namespace nilio::tools::inspect {

namespace {

constexpr double kParallel = 20.0 * std::numbers::pi / 180.0;
// Angles with a larger standard deviation count as not observed.
constexpr double kLargestSigma = 5.0 * std::numbers::pi / 180.0;

bool is_one_line(const std::vector<DirectionPair>& pairs) {
  return std::all_of(pairs.begin(), pairs.end(), [&](const DirectionPair& pair) {
    return std::abs(pair.measured.dot(pairs.front().measured)) > std::cos(kParallel);
  });
}

/// Smallest rotation from one direction to another; upside down is a roll, as in usual mountings.
core::Matrix3 smallest_rotation(const core::Vector3& from, const core::Vector3& to) {
  constexpr double kOpposite = -0.9999;
  if (from.dot(to) < kOpposite) {
    const core::Vector3 axis = (core::Vector3::UnitX() - core::Vector3::UnitX().dot(to) * to);
    const core::Vector3 chosen = axis.norm() > 0.5 ? axis.normalized() : core::Vector3::UnitY().eval();
    return Eigen::AngleAxisd(std::numbers::pi, chosen).toRotationMatrix();
  }
  return Eigen::Quaterniond::FromTwoVectors(from, to).toRotationMatrix();
}

std::array<double, 3> sigmas(const std::vector<DirectionPair>& pairs) {
  // Information about a small rotation of the actual axes: a direction carries none about rotation around
  // itself.
  core::Matrix3 information = 1e-3 * core::Matrix3::Identity();
  for (const DirectionPair& pair : pairs)
    information +=
        (core::Matrix3::Identity() - pair.actual * pair.actual.transpose()) / (pair.sigma * pair.sigma);
  const core::Matrix3 covariance = information.inverse();
  std::array<double, 3> result{};
  for (Eigen::Index i = 0; i < 3; ++i) {
    const double sigma = std::sqrt(covariance(i, i));
    result[static_cast<std::size_t>(i)] =
        sigma < kLargestSigma ? sigma : std::numeric_limits<double>::infinity();
  }
  return result;
}

}  // namespace

AxesFit fit_axes(const std::vector<DirectionPair>& pairs, bool mirrors) {
  AxesFit fit;
  if (pairs.empty()) return fit;
  fit.known = true;
  fit.sigma = sigmas(pairs);
  core::Matrix3 profile = core::Matrix3::Zero();
  core::Vector3 measured = core::Vector3::Zero();
  core::Vector3 actual = core::Vector3::Zero();
  for (const DirectionPair& pair : pairs) {
    const double weight = 1.0 / (pair.sigma * pair.sigma);
    profile += weight * pair.actual * pair.measured.transpose();
    const double sign = pair.measured.dot(pairs.front().measured) < 0.0 ? -1.0 : 1.0;
    measured += sign * weight * pair.measured;
    actual += sign * weight * pair.actual;
  }
  if (is_one_line(pairs)) {
    if (measured.norm() == 0.0 || actual.norm() == 0.0) return {};
    fit.matrix = smallest_rotation(measured.normalized(), actual.normalized());
    return fit;
  }
  const Eigen::JacobiSVD<core::Matrix3> svd(profile, Eigen::ComputeFullU | Eigen::ComputeFullV);
  core::Vector3 handedness = core::Vector3::Ones();
  if (!mirrors) handedness.z() = (svd.matrixU() * svd.matrixV().transpose()).determinant() < 0.0 ? -1.0 : 1.0;
  fit.matrix = svd.matrixU() * handedness.asDiagonal() * svd.matrixV().transpose();
  return fit;
}

core::Matrix3 nearest_axes(const core::Matrix3& matrix) {
  std::array<int, 3> order{0, 1, 2};
  std::array<int, 3> best = order;
  double largest = -1.0;
  do {
    double sum = 0.0;
    for (int row = 0; row < 3; ++row) sum += std::abs(matrix(row, order[static_cast<std::size_t>(row)]));
    if (sum <= largest) continue;
    largest = sum;
    best = order;
  } while (std::next_permutation(order.begin(), order.end()));
  core::Matrix3 result = core::Matrix3::Zero();
  for (int row = 0; row < 3; ++row) {
    const int column = best[static_cast<std::size_t>(row)];
    result(row, column) = matrix(row, column) < 0.0 ? -1.0 : 1.0;
  }
  return result;
}

double angle_between(const core::Matrix3& a, const core::Matrix3& b) {
  const core::Matrix3 difference = a * b.transpose();
  if (difference.determinant() < 0.0) return std::numbers::pi;
  return core::so3_log(Eigen::Quaterniond(difference)).norm();
}

MirroredRotation split_mirror(const core::Matrix3& matrix) {
  if (matrix.determinant() > 0.0) return {matrix, {}};
  // Tolerance for equal angles.
  constexpr double kSame = 1e-6;
  const std::array<std::array<bool, 3>, 4> choices = {{
      {false, false, true},
      {false, true, false},
      {true, false, false},
      {true, true, true},
  }};
  MirroredRotation best;
  double least = 10.0;
  for (const auto& negated : choices) {
    core::Matrix3 rotation = matrix;
    for (Eigen::Index i = 0; i < 3; ++i)
      if (negated[static_cast<std::size_t>(i)]) rotation.col(i) *= -1.0;
    const double angle = angle_between(rotation, core::Matrix3::Identity());
    if (angle >= least - kSame) continue;
    least = angle;
    best = {rotation, negated};
  }
  return best;
}

}  // namespace nilio::tools::inspect
