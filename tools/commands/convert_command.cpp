#include "daemon/exit_status.hpp"
#include "tools/commands/command_line.hpp"
#include "tools/commands/commands.hpp"
#include "tools/convert/capture.hpp"
#include "tools/convert/convert.hpp"
#include "tools/convert/run.hpp"

#include <cmath>
#include <iostream>
#include <memory>
#include <string>
#include <vector>

#include <CLI/CLI.hpp>

namespace nilio::tools {

namespace {

/// `capture` or `bag` with its options: both take any recording.
void add_capture_command(CLI::App& parent, const char* name, const char* description, const char* explanation,
                         const char* keys, int& status) {
  const auto options = std::make_shared<convert::CaptureOptions>();
  CLI::App* const command = parent.add_subcommand(name, description);
  const std::string fields =
      "Writes scan_000000.pcd (or .ply, .csv), ... and scans.csv with the times of the scans. Fields: x, y, "
      "z in "
      "metres in the sensor's frame (x forward, y left, z up); intensity 0 to 255; ring, 0 = lowest beam; "
      "return: 0 = the only one, 1 = last, 2 = strongest, or second strongest where the strongest is the "
      "last; "
      "time in seconds since the scan's first firing; azimuth in degrees, clockwise from forward. Every "
      "return "
      "is written, whatever its range, and points are not deskewed. PCD and PLY are binary.\n";
  command->footer(fields + explanation + " --config and --set take niliod's keys: " + keys + ", ...");
  command->add_option("recording", options->recording, "capture, ROS bag, or folder of a recording")
      ->required();
  command->add_option("output", options->output, "folder for the scans, created if missing")->required();
  command->add_option("--format", options->format, "pcd (default), ply or csv")
      ->transform(choice_of<convert::PointFormat>({{"pcd", convert::PointFormat::kPcd},
                                                   {"ply", convert::PointFormat::kPly},
                                                   {"csv", convert::PointFormat::kCsv}}));
  command->add_option("--config", options->config_file, "configuration file of niliod (YAML)");
  command
      ->add_option("--set", options->overrides,
                   "one key, such as lidar.calibration=unit.yaml; may be repeated")
      ->take_all()
      ->expected(1);
  command->add_option("--first", options->first, "number of the first scan to write")->capture_default_str();
  command->add_option("--count", options->count, "number of scans to write (default: all)");
  command->callback([options, &status] {
    const auto converted = convert::convert_capture(*options);
    if (!converted) std::cerr << "nilio convert: " << converted.error().message << '\n';
    status = converted ? kDone : kFailed;
  });
}

/// `run` with its options.
void add_run_command(CLI::App& parent, int& status) {
  using convert::RunFormat;
  const auto arguments = std::make_shared<convert::RunOptions>();
  convert::RunOptions& options = *arguments;
  CLI::App* const command =
      parent.add_subcommand("run", "poses of a run, a trajectory or a ROS bag to other formats");
  command->footer(
      "tum: time x y z qx qy qz qw, poses of base_link; kitti: rows of [R|t], those of trajectory.kitti for "
      "an "
      "output folder; csv: poses with angles and path length, and for an output folder the columns of "
      "scans.csv; "
      "geojson: a line with altitudes and times (RFC 7946), for maps; mcap: /pose, /tf and /path for "
      "Foxglove and "
      "PlotJuggler, without the scans and diagnostics of run.mcap.\n"
      "Poses of a bag are those of nav_msgs/Odometry, geometry_msgs/PoseStamped, PoseWithCovarianceStamped "
      "and "
      "TransformStamped: the reference trajectory of a data set becomes a file for 'nilio evaluate'.");
  command->add_option("run", options.run, "output folder of niliod, trajectory file (TUM, KITTI), or ROS bag")
      ->required();
  command->add_option("--to", options.format, "tum, kitti, csv, geojson or mcap")
      ->required()
      ->transform(choice_of<RunFormat>({{"tum", RunFormat::kTum},
                                        {"kitti", RunFormat::kKitti},
                                        {"csv", RunFormat::kCsv},
                                        {"geojson", RunFormat::kGeoJson},
                                        {"mcap", RunFormat::kMcap}}));
  command->add_option("--output", options.output, "file to write (default: standard output)");
  command->add_option("--topic", options.topic, "topic of a bag with several topics of poses");
  add_origin_option(*command, options.origin, "geojson: place of the origin of the poses");
  command
      ->add_option(
          "--gnss", options.gnss_recording,
          "geojson: ROS bag, capture or CSV file with GNSS positions, by which the place and heading of "
          "the poses' frame are found (its z axis is taken as up)")
      ->excludes("--origin");
  command->add_option("--gnss-topic", options.gnss_topic, "topic of a bag with several topics of positions");
  add_georeference_options(*command, options.georeference);
  command->callback([arguments, &status] {
    const auto converted = convert::convert_run(*arguments);
    if (!converted) std::cerr << "nilio convert: " << converted.error().message << '\n';
    status = converted ? kDone : kFailed;
  });
}

/// `gnss` with its options.
void add_gnss_command(CLI::App& parent, int& status) {
  using convert::RunFormat;
  const auto options = std::make_shared<convert::GnssOptions>();
  CLI::App* const command = parent.add_subcommand("gnss", "positions of a GNSS receiver to CSV or GeoJSON");
  command->footer(
      "Reads sensor_msgs/NavSatFix and nmea_msgs/Sentence (RMC, GGA) of ROS bags, and the sentences in the "
      "position packets of captures. csv: time, latitude, longitude, altitude above the WGS 84 ellipsoid, "
      "standard "
      "deviations as the receiver states them, quality, and the position east, north and up of the first "
      "one. "
      "'nilio evaluate' takes the CSV file and the recording as truth.");
  command->add_option("recording", options->recording, "ROS bag, capture, or CSV file of this command")
      ->required();
  command->add_option("--to", options->format, "csv (default) or geojson")
      ->transform(choice_of<RunFormat>({{"csv", RunFormat::kCsv}, {"geojson", RunFormat::kGeoJson}}));
  command->add_option("--output", options->output, "file to write (default: standard output)");
  command->add_option("--topic", options->topic, "topic of a bag with several topics of positions");
  command->callback([options, &status] {
    const auto converted = convert::convert_gnss(*options);
    if (!converted) std::cerr << "nilio convert: " << converted.error().message << '\n';
    status = converted ? kDone : kFailed;
  });
}

int run_convert(const convert::Options& options) {
  const auto status = convert::convert_kitti_raw(options);
  if (status) return *status;
  std::cerr << "nilio convert: " << status.error().message << '\n';
  return 1;
}

}  // namespace

void add_convert_command(CLI::App& app, int& status) {
  auto arguments = std::make_shared<convert::Options>();
  CLI::App* command = app.add_subcommand(
      "convert",
      "captures and ROS bags to point clouds, runs and GNSS tracks to other formats, and KITTI's drives to "
      "captures");
  command->require_subcommand(1);
  add_capture_command(
      *command, "capture", "captures of any Velodyne to one point cloud per scan",
      "The sensor is identified from its packets; an HDL-64E's calibration is read from its status stream.",
      "lidar.model, lidar.calibration, lidar.port, lidar.returns", status);
  add_capture_command(*command, "bag", "ROS bags (rosbag1, db3, MCAP) to one point cloud per scan",
                      "Packets and point clouds of any LiDAR are read as niliod reads them; times of points "
                      "and beams are those "
                      "that were recognised.",
                      "recording.lidar_topic, recording.point_times, lidar.calibration", status);
  add_run_command(*command, status);
  add_gnss_command(*command, status);
  CLI::App* kitti = command->add_subcommand(
      "kitti-raw", "KITTI raw drive to lidar.pcap, imu.candump.log, truth.tum, gnss.csv and nilio.yaml");
  kitti->footer(
      "Scans become the HDL-64E packets they were made of and are read back as a check. Reflectance 0..1 is "
      "written as 0..255. The times in KITTI's files have no time zone and are read as UTC. truth.tum is "
      "the LiDAR's trajectory from the OXTS receiver, starting at the identity, and gnss.csv its positions; "
      "without oxts/ there is neither of them, nor imu.candump.log. Scans without a time are left out. Files "
      "in OUTPUT_DIR are "
      "replaced.");
  kitti->add_option("drive", arguments->drive, "unpacked drive, <date>/<date>_drive_<number>_sync")
      ->required();
  kitti->add_option("output", arguments->output, "folder for the result, created if missing")->required();
  kitti->add_option(
      "--oxts", arguments->oxts_drive,
      "take the OXTS records from this drive, e.g. <date>_drive_<number>_extract, which has 100 Hz");
  kitti->callback([arguments, &status] { status = run_convert(*arguments); });
}

}  // namespace nilio::tools
