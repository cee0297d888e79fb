#pragma once

#include "nilio/core/result.hpp"

#include "tools/common/trajectory.hpp"

#include <span>
#include <vector>

#include "mapping/map_folder.hpp"
#include "mapping/point_cloud.hpp"

namespace nilio::tools::map {

using mapping::CloudPoint;

/// Box in the map frame, metres.
struct Box {
  core::Vector3 minimum = core::Vector3::Zero();
  core::Vector3 maximum = core::Vector3::Zero();
  [[nodiscard]] bool contains(const core::Vector3& p) const {
    return (p.array() >= minimum.array()).all() && (p.array() <= maximum.array()).all();
  }
};

/// All surfaces of a map in order of the submaps, 64 bytes each. A damaged submap is an error that names it.
core::Result<std::vector<CloudPoint>> read_cloud(const mapping::MapReader& map);

/// Poses of all keyframes in the map frame in order of time, each once.
core::Result<Trajectory> read_path(const mapping::MapReader& map);
/// Appends the keyframes of the next submap.
void add_path(std::span<const mapping::SubmapKeyframe> keyframes, const core::SE3& T_map_submap,
              Trajectory& path);

}  // namespace nilio::tools::map
