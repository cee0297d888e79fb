#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/scan.hpp"

#include <cstdint>
#include <limits>
#include <string>
#include <variant>
#include <vector>

namespace nilio::tools::convert {

enum class PointFormat : std::uint8_t {
  kPcd,  ///< binary, version 0.7
  kPly,  ///< binary, little-endian
  kCsv,
};

/// "pcd", "ply", "csv".
const char* extension_of(PointFormat format);

/// Writes the points of a scan with the fields x, y, z (metres), intensity, ring, return
/// (Point::return_kind), time (seconds since Scan::start) and azimuth (of the point, degrees clockwise from
/// the x axis, 0 to 360). The file has its name only when it is complete. Errors name it.
core::Result<std::monostate> write_points(const core::Scan& scan, PointFormat format,
                                          const std::string& path);

/// Options of "nilio convert capture" and "nilio convert bag".
struct CaptureOptions {
  /// A capture, a ROS bag, or the folder of a recording.
  std::string recording;
  /// Folder for the scans, created if missing.
  std::string output;
  PointFormat format = PointFormat::kPcd;
  /// Configuration of niliod: section lidar. Empty = that of the recording, if there is one.
  std::string config_file;
  std::vector<std::string> overrides;
  /// Number of the first scan to write, and how many.
  std::uint64_t first = 0;
  std::uint64_t count = std::numeric_limits<std::uint64_t>::max();
};

/// Writes every return of each scan to scan_000000.pcd and so on, whatever its range, and scans.csv with the
/// times of the scans. Prints a summary. Fails without a single scan, and when the folder holds an earlier
/// conversion.
core::Result<std::monostate> convert_capture(const CaptureOptions& options);

}  // namespace nilio::tools::convert
