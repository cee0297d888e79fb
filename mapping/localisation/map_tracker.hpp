#pragma once

#include "nilio/core/se3.hpp"

#include <optional>
#include <vector>

#include "mapping/keyframe.hpp"
#include "mapping/localisation/saved_map.hpp"
#include "mapping/loops/surface_index.hpp"

namespace nilio::mapping {

/// Registration of a keyframe against the surfaces of a map.
struct MapMatch {
  core::SE3 T_map_base;
  /// Of an error on the right: translation then rotation, in axes of the vehicle; m^2, rad^2. Prediction and
  /// registration together.
  core::Matrix6 covariance = core::Matrix6::Identity();
  /// Share of the points that lie on surfaces of the map.
  double supported = 0.0;
  /// Whether the registration entered the pose; false: the world differs from the map here, or there is no
  /// map, and the pose is the predicted one.
  bool is_used = false;
};

/// Keeps a vehicle localised: each keyframe is registered against the surfaces of the map around it, with
/// the prediction of odometry as prior. The map does not change. One thread.
class MapTracker {
 public:
  explicit MapTracker(const SavedMap& map) : map_(map) {}

  /// Begins at a pose.
  void start(const core::SE3& T_map_base, const core::SE3& T_odom_base, const core::Matrix6& covariance);
  /// The next keyframe.
  MapMatch add(const Keyframe& keyframe);

 private:
  void load_around(const core::Vector3& position);

  const SavedMap& map_;
  core::SE3 T_map_base_;
  core::SE3 T_odom_base_;
  core::Matrix6 covariance_ = core::Matrix6::Identity();
  /// Origin of the loaded surfaces in the map.
  std::optional<core::Vector3> origin_;
  std::optional<SurfaceIndex> surfaces_;
};

}  // namespace nilio::mapping
