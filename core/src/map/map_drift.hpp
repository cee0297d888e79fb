#pragma once

#include "nilio/core/se3.hpp"

namespace nilio::core {

/// Covariance of the drift of a map that is built from the poses registered to it (docs/algorithm.md, 10).
/// The map takes every scan with the error of its pose, and moves by the share that the scan has in the
/// planes: little in known surroundings, all of it where new ones begin. Errors act on the left, in axes of
/// the map, so that they stay what they are while the vehicle drives on. Not thread-safe.
class MapDrift {
 public:
  /// The map takes a scan at this pose of base_link; `covariance`: of the pose against the map, in axes of
  /// base_link (translation, then rotation).
  void take(const SE3& T_map_base, const Matrix6& covariance);
  /// A scan is registered at this pose, in planes of which the scan that was taken last makes up `share`
  /// (identity: all), with the `gain` of the filter's update; both in axes of base_link.
  void follow(const SE3& T_map_base, const Matrix6& share, const Matrix6& gain);
  /// Covariance of a pose of base_link that is exactly known in the map, in axes of base_link.
  [[nodiscard]] Matrix6 at(const SE3& T_map_base) const;

 private:
  Matrix6 pose_ = Matrix6::Zero();         ///< of the scan that was taken last, against the map
  Matrix6 correlation_ = Matrix6::Zero();  ///< of the map's error with that of the pose against the map
  bool has_taken_ = false;                 ///< since the last registration
  Matrix6 covariance_ = Matrix6::Zero();
};

}  // namespace nilio::core
