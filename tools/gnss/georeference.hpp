#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/time.hpp"

#include "tools/common/trajectory.hpp"
#include "tools/gnss/geodetic.hpp"
#include "tools/gnss/track.hpp"

#include <optional>
#include <vector>

namespace nilio::tools::gnss {

struct GeoreferenceOptions {
  /// Antenna in the body's frame of the trajectory, metres.
  Eigen::Vector3d antenna = Eigen::Vector3d::Zero();
  /// Added to the times of the track.
  core::Duration time_offset{};
  /// Largest distance of the poses around a position.
  core::Duration max_gap = core::Duration::from_seconds(0.2);
};

/// A position of the track, and the trajectory's at the same time.
struct Match {
  core::Time stamp;
  Eigen::Vector3d track;     ///< east, north, up
  Eigen::Vector3d estimate;  ///< the antenna by the trajectory, in the same frame
  bool has_altitude = false;
  /// Stated standard deviations, horizontal axis and up.
  std::optional<double> deviation_m;
  std::optional<double> up_deviation_m;
};

/// A trajectory on the earth.
struct Georeference {
  GeodeticOrigin origin;       ///< place and heading of the trajectory's frame
  std::vector<Match> matches;  ///< in order of time
  double scale = 1.0;          ///< size of the track over that of the trajectory; not applied
  /// Addition to the times of the track that fits best; empty where the drive does not show it.
  std::optional<core::Duration> better_offset;
};

/// Heading and position of a trajectory whose z axis is up, by least squares over the horizontal positions
/// with Huber's weights and those of the stated deviations, and the median of the altitudes. Fails where the
/// times do not overlap, for fewer than three matches, and for a path that is too short for a heading.
core::Result<Georeference> georeference(const Trajectory& trajectory, const Track& track,
                                        const GeoreferenceOptions& options);

}  // namespace nilio::tools::gnss
