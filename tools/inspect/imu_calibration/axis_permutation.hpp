#pragma once

#include "nilio/core/se3.hpp"

#include <array>
#include <limits>
#include <vector>

namespace nilio::tools::inspect {

/// One direction as measured by the IMU and from the registered motion, unit vectors in base_link.
struct DirectionPair {
  core::Vector3 measured = core::Vector3::Zero();
  core::Vector3 actual = core::Vector3::Zero();
  double sigma = 0.0;  ///< rad
};

/// Orthogonal matrix from measured to actual directions.
struct AxesFit {
  bool known = false;
  core::Matrix3 matrix = core::Matrix3::Identity();
  /// About x, y and z, rad; infinite if not observed.
  std::array<double, 3> sigma{std::numeric_limits<double>::infinity(),
                              std::numeric_limits<double>::infinity(),
                              std::numeric_limits<double>::infinity()};
};

/// Solves Wahba's problem by singular value decomposition. `mirrors` allows reflections, for which the pairs
/// have to span space; otherwise the result is a rotation, for a single direction the smallest one.
AxesFit fit_axes(const std::vector<DirectionPair>& pairs, bool mirrors);

/// The signed permutation of axes nearest to an orthogonal matrix.
core::Matrix3 nearest_axes(const core::Matrix3& matrix);
/// Angle between two orthogonal matrices of the same handedness, rad; pi when it differs.
double angle_between(const core::Matrix3& a, const core::Matrix3& b);

/// An orthogonal matrix as a rotation after negation of axes.
struct MirroredRotation {
  core::Matrix3 rotation = core::Matrix3::Identity();
  std::array<bool, 3> negated{};
};
/// The decomposition with the smallest rotation, among equal ones with fewest negated axes.
MirroredRotation split_mirror(const core::Matrix3& matrix);

}  // namespace nilio::tools::inspect
