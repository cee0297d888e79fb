#include "tools/convert/run.hpp"

#include "nilio/core/units.hpp"
#include "nilio/drivers/bag/bag.hpp"

#include "tools/common/files.hpp"
#include "tools/common/text.hpp"
#include "tools/common/trajectory.hpp"
#include "tools/convert/run_poses.hpp"
#include "tools/gnss/track.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <iostream>
#include <string>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

namespace nilio::tools::convert {

namespace {

namespace fs = std::filesystem;
using core::Error;
using core::Result;

constexpr const char* kTrajectory = "trajectory.tum";

bool is_run_folder(const fs::path& path) {
  std::error_code code;
  return fs::exists(path / kTrajectory, code);
}

Result<Trajectory> read_poses(const RunOptions& options) {
  if (is_run_folder(options.run)) {
    // A run states its poses for KITTI's metrics in the frame of the LiDAR, from the first one.
    const bool is_kitti = options.format == RunFormat::kKitti;
    return read_trajectory((fs::path(options.run) / (is_kitti ? "trajectory.kitti" : kTrajectory)).string());
  }
  if (drivers::is_bag(options.run)) return read_bag_poses(options.run, options.topic);
  std::error_code code;
  if (fs::is_directory(options.run, code))
    return Error{options.run + ": holds neither " + kTrajectory +
                 " nor a ROS bag - give the output folder of a run"};
  return read_trajectory(options.run);
}

double rounded(double value, double unit) { return std::round(value / unit) * unit; }

std::string csv_text(const Trajectory& trajectory, const ScanColumns& columns) {
  std::string text = "stamp_s,x_m,y_m,z_m,qx,qy,qz,qw,roll_deg,pitch_deg,yaw_deg,path_m";
  const bool has_columns = !columns.names.empty();
  if (has_columns) text += "," + columns.names;
  text += '\n';
  const std::string no_columns(static_cast<std::size_t>(std::ranges::count(columns.names, ',')), ',');
  const std::vector<double> lengths = path_lengths(trajectory.poses);
  for (std::size_t i = 0; i < trajectory.poses.size(); ++i) {
    const core::SE3 pose = se3_of(trajectory.poses[i]);
    const Eigen::Matrix3d r = pose.rotation.toRotationMatrix();
    const Eigen::Vector3d& t = pose.translation;
    const Eigen::Quaterniond& q = pose.rotation;
    const std::string stamp = stamp_text(trajectory.stamps[i]);
    text += stamp;
    text += format(",%.9f,%.9f,%.9f,%.9f,%.9f,%.9f,%.9f,%.6f,%.6f,%.6f,%.4f", t.x(), t.y(), t.z(), q.x(),
                   q.y(), q.z(), q.w(), std::atan2(r(2, 1), r(2, 2)) / kRadiansPerDegree,
                   std::asin(std::clamp(-r(2, 0), -1.0, 1.0)) / kRadiansPerDegree,
                   std::atan2(r(1, 0), r(0, 0)) / kRadiansPerDegree, lengths[i]);
    if (has_columns) {
      const auto row = columns.rows.find(stamp);
      text += ',';
      text += row == columns.rows.end() ? no_columns : row->second;
    }
    text += '\n';
  }
  return text;
}

/// A line of latitudes, longitudes and altitudes with its times.
std::string geojson_line(const std::vector<std::array<double, 3>>& places,
                         const std::vector<core::Time>& stamps, nlohmann::json properties) {
  nlohmann::json line = nlohmann::json::array();
  nlohmann::json times = nlohmann::json::array();
  for (std::size_t i = 0; i < places.size(); ++i) {
    const auto& [latitude, longitude, altitude] = places[i];
    line.push_back({rounded(longitude, 1e-9), rounded(latitude, 1e-9), rounded(altitude, 1e-3)});
    times.push_back(iso_text(stamps[i]));
  }
  properties["coordTimes"] = std::move(times);
  const nlohmann::json feature{{"type", "Feature"},
                               {"geometry", {{"type", "LineString"}, {"coordinates", std::move(line)}}},
                               {"properties", std::move(properties)}};
  const nlohmann::json collection{{"type", "FeatureCollection"},
                                  {"features", nlohmann::json::array({feature})}};
  return collection.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace) + '\n';
}

/// The given place of the poses' frame, or that by GNSS.
Result<gnss::GeodeticOrigin> find_origin(const Trajectory& trajectory, const RunOptions& options) {
  if (options.origin) return *options.origin;
  if (options.gnss_recording.empty())
    return Error{
        "--origin: GeoJSON needs the place and heading of the first frame - give LAT,LON,ALT,HEADING, or a "
        "recording with GNSS by --gnss"};
  const auto track = gnss::read_track(options.gnss_recording, options.gnss_topic);
  if (!track) return track.error();
  const auto found = gnss::georeference(trajectory, *track, options.georeference);
  if (!found) return found.error();
  return found->origin;
}

Result<std::string> track_geojson(const gnss::Track& track) {
  if (track.fixes.size() < 2) return Error{track.name + ": has one position; a line needs two"};
  std::vector<std::array<double, 3>> places;
  std::vector<core::Time> stamps;
  for (const gnss::Fix& fix : track.fixes) {
    places.push_back({fix.latitude_deg, fix.longitude_deg, fix.altitude_m.value_or(0.0)});
    stamps.push_back(fix.stamp);
  }
  return geojson_line(places, stamps, {{"name", track.name}, {"notes", track.notes}});
}

/// To standard output without a path; `content` is a line about it.
Result<std::monostate> write_output(const std::string& path, const std::string& text,
                                    const std::string& content) {
  if (path.empty()) {
    std::cout << text << std::flush;
    if (!std::cout) return Error{"standard output: cannot be written"};
    return std::monostate{};
  }
  if (auto written = write_text(path, text); !written) return written;
  std::cout << path << ": " << content << '\n';
  return std::monostate{};
}

Result<std::string> text_of(const Trajectory& trajectory, const RunOptions& options) {
  if (options.format == RunFormat::kCsv)
    return csv_text(trajectory, is_run_folder(options.run) ? read_scan_columns(options.run) : ScanColumns{});
  if (options.format == RunFormat::kGeoJson) {
    if (trajectory.poses.size() < 2) return Error{options.run + ": has one pose; a line needs two"};
    const auto origin = find_origin(trajectory, options);
    if (!origin) return origin.error();
    return geojson_text(trajectory, fs::path(options.run).filename().string(), *origin);
  }
  Trajectory converted = trajectory;
  converted.format = options.format == RunFormat::kKitti ? TrajectoryFormat::kKitti : TrajectoryFormat::kTum;
  return trajectory_text(converted);
}

}  // namespace

std::string geojson_text(const Trajectory& trajectory, const std::string& name,
                         const gnss::GeodeticOrigin& origin) {
  const gnss::GeodeticFrame frame(origin);
  std::vector<std::array<double, 3>> places;
  for (const Pose& pose : trajectory.poses) places.push_back(frame.geodetic(pose.translation()));
  return geojson_line(places, trajectory.stamps,
                      {{"name", name}, {"path_length_m", rounded(path_length(trajectory.poses), 1e-3)}});
}

std::string kml_text(const Trajectory& trajectory, const gnss::GeodeticOrigin& origin) {
  const gnss::GeodeticFrame frame(origin);
  std::string text =
      "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<kml xmlns=\"http://www.opengis.net/kml/2.2\"><Document>"
      "<Placemark><name>path</name><LineString><tessellate>1</tessellate>"
      "<altitudeMode>clampToGround</altitudeMode><coordinates>\n";
  for (const Pose& pose : trajectory.poses) {
    const auto [latitude, longitude, altitude] = frame.geodetic(pose.translation());
    text += format("%.9f,%.9f\n", longitude, latitude);
  }
  return text + "</coordinates></LineString></Placemark></Document></kml>\n";
}

Result<std::monostate> convert_gnss(const GnssOptions& options) {
  const auto track = gnss::read_track(options.recording, options.topic);
  if (!track) return track.error();
  const Result<std::string> text =
      options.format == RunFormat::kGeoJson ? track_geojson(*track) : Result(gnss::csv_text(*track));
  if (!text) return text.error();
  if (!options.output.empty()) {
    for (const std::string& note : track->notes) std::cout << track->name << ": " << note << '\n';
  }
  return write_output(options.output, *text, gnss::summary(*track));
}

Result<std::monostate> convert_run(const RunOptions& options) {
  const auto trajectory = read_poses(options);
  if (!trajectory) return trajectory.error();
  if (trajectory->stamps.empty() && options.format != RunFormat::kKitti)
    return Error{trajectory->path +
                 ": has no times - give a TUM file, an output folder of niliod or a ROS bag"};
  const std::string content = std::to_string(trajectory->poses.size()) + " poses";
  if (options.format != RunFormat::kMcap) {
    const auto text = text_of(*trajectory, options);
    if (!text) return text.error();
    return write_output(options.output, *text, content);
  }
  if (options.output.empty())
    return Error{"--output: an MCAP file is not written to standard output - name a file"};
  if (auto written = write_mcap(*trajectory, options.output); !written) return written;
  std::cout << options.output << ": " << content << '\n';
  return std::monostate{};
}

}  // namespace nilio::tools::convert
