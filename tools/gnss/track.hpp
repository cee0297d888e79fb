#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/time.hpp"

#include "tools/gnss/geodetic.hpp"

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace nilio::tools::gnss {

/// Position of a receiver's antenna, WGS 84.
struct Fix {
  core::Time stamp;
  double latitude_deg = 0.0;
  double longitude_deg = 0.0;
  std::optional<double> altitude_m;
  /// Standard deviations that the receiver states: east, north, up (not finite where it states none), metres.
  std::optional<std::array<double, 3>> deviation_m;
  std::string quality;  ///< "fix", "sbas", "gbas"; of NMEA "autonomous", "differential", "rtk", ...

  /// Stated standard deviation of one horizontal axis; empty if it is not stated.
  [[nodiscard]] std::optional<double> horizontal_deviation_m() const;
};

/// Positions in the order of time.
struct Track {
  std::string name;  ///< file, and topic of a bag
  std::vector<Fix> fixes;
  /// NMEA without the height of the geoid; otherwise altitudes are above the WGS 84 ellipsoid.
  bool above_sea_level = false;
  std::uint64_t without_fix = 0;
  /// Damaged, repeated, or not in the order of time.
  std::uint64_t left_out = 0;
  /// Lines about the recording and the source of the times.
  std::vector<std::string> notes;
};

/// Whether a file may hold a track: a ROS bag, a capture, or a CSV file with the columns of csv_text().
bool may_hold_track(const std::string& path);

/// Reads sensor_msgs/NavSatFix or nmea_msgs/Sentence of a ROS bag (of the only such topic if `topic` is
/// empty; NavSatFix first), the sentences of position packets of a capture, or a CSV file with columns
/// stamp_s, latitude_deg, longitude_deg and, optionally, altitude_m, std_east_m, std_north_m, std_up_m.
///
/// Times of sentences are their own where they agree to 1 s with those of the messages, whose delay they
/// lack. RMC sentences are left out where GGA sentences, which have altitudes, are there. Fails without any
/// fix.
core::Result<Track> read_track(const std::string& path, const std::string& topic = {});
/// The same for the files of a ROS bag (see drivers::bag_files()).
core::Result<Track> read_bag_track(const std::vector<std::string>& files, const std::string& topic);

/// East-north-up frame at a position.
GeodeticFrame frame_at(const Fix& fix);
/// A position in such a frame; one without an altitude is taken to be on the ellipsoid.
Eigen::Vector3d local(const GeodeticFrame& frame, const Fix& fix);

// One kind of recording each, unchecked: stamps may repeat, and there may be no position.
core::Result<Track> read_bag(const std::vector<std::string>& files, const std::string& topic);
core::Result<Track> read_capture(const std::string& path);
core::Result<Track> read_csv(const std::string& path);
/// Whether the first line names the columns of a track.
bool is_csv_track(const std::string& path);

/// Median of the stated horizontal standard deviations; empty without any.
std::optional<double> median_deviation_m(const Track& track);

/// Length of the track, metres, without steps shorter than three stated deviations (0.5 m if none is).
double track_length_m(const Track& track);

/// The columns above, quality, and the position east, north and up of the first fix.
std::string csv_text(const Track& track);

/// Line for a report: positions, qualities, stated accuracy, length, place of the first one.
std::string summary(const Track& track);

}  // namespace nilio::tools::gnss
