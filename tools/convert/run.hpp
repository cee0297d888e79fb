#pragma once

#include "nilio/core/result.hpp"

#include "tools/common/trajectory.hpp"
#include "tools/gnss/geodetic.hpp"
#include "tools/gnss/georeference.hpp"

#include <cstdint>
#include <optional>
#include <string>
#include <variant>

namespace nilio::tools::convert {

enum class RunFormat : std::uint8_t {
  kTum,
  kKitti,
  kCsv,      ///< poses with angles and path length, and the columns of scans.csv
  kGeoJson,  ///< a line on the WGS 84 ellipsoid (RFC 7946)
  kMcap,     ///< /pose, /tf, /path
};

/// Options of "nilio convert run".
struct RunOptions {
  /// Output folder of niliod, trajectory file (TUM, KITTI), or ROS bag with poses.
  std::string run;
  RunFormat format = RunFormat::kTum;
  /// Empty = standard output, for the formats that are text.
  std::string output;
  /// Topic of a bag; empty = the only one with poses.
  std::string topic;
  /// For GeoJSON: place of the frame of the poses, or a recording with GNSS positions (and the topic of a
  /// bag) by which it is found.
  std::optional<gnss::GeodeticOrigin> origin;
  std::string gnss_recording;
  std::string gnss_topic;
  gnss::GeoreferenceOptions georeference;
};

/// Poses, two at least, as a line on the WGS 84 ellipsoid (RFC 7946) with their times as property coordTimes.
std::string geojson_text(const Trajectory& trajectory, const std::string& name,
                         const gnss::GeodeticOrigin& origin);

/// The same as KML (OGC 12-007r2), drawn on the ground: its altitudes would be above mean sea level.
std::string kml_text(const Trajectory& trajectory, const gnss::GeodeticOrigin& origin);

/// Options of "nilio convert gnss".
struct GnssOptions {
  std::string recording;
  std::string topic;
  RunFormat format = RunFormat::kCsv;  ///< or kGeoJson
  std::string output;                  ///< empty = standard output
};

/// Writes the track of a GNSS receiver.
core::Result<std::monostate> convert_gnss(const GnssOptions& options);

/// Writes the poses of a run in another format. Fails with what is missing: times, an origin, a topic.
core::Result<std::monostate> convert_run(const RunOptions& options);

}  // namespace nilio::tools::convert
