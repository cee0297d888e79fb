#include "tools/mangle/return_faults.hpp"

#include <array>
#include <cmath>
#include <unordered_map>

#include <Eigen/Eigenvalues>

namespace nilio::tools::mangle {

namespace {

constexpr float kVoxelM = 1.0F;
constexpr std::uint32_t kMinReturns = 6;
constexpr double kMinScattering = 0.1;

struct Moments {
  std::uint32_t count = 0;
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  Eigen::Matrix3d squares = Eigen::Matrix3d::Zero();

  void add(const Eigen::Vector3d& p) {
    ++count;
    sum += p;
    squares += p * p.transpose();
  }
  [[nodiscard]] bool scatters() const {
    if (count < kMinReturns) return false;
    const Eigen::Vector3d mean = sum / count;
    const Eigen::Matrix3d covariance = squares / count - mean * mean.transpose();
    const Eigen::Vector3d variances =
        Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(covariance, Eigen::EigenvaluesOnly).eigenvalues();
    return variances[0] > kMinScattering * variances[2];
  }
};

/// Voxel of a position, which is within the reach of the sensor.
std::int64_t voxel_of(const Eigen::Vector3f& p) {
  std::int64_t key = 0;
  for (int axis = 0; axis < 3; ++axis)
    key = key * 4096 + static_cast<std::int64_t>(std::floor(p[axis] / kVoxelM)) + 2048;
  return key;
}

}  // namespace

std::vector<bool> find_vegetation(std::span<const Return> scan) {
  std::unordered_map<std::int64_t, Moments> voxels;
  for (const Return& given : scan) voxels[voxel_of(given.position)].add(given.position.cast<double>());
  std::unordered_map<std::int64_t, bool> scatters;
  for (const auto& [key, moments] : voxels) scatters[key] = moments.scatters();
  std::vector<bool> result;
  result.reserve(scan.size());
  for (const Return& given : scan) result.push_back(scatters[voxel_of(given.position)]);
  return result;
}

}  // namespace nilio::tools::mangle
