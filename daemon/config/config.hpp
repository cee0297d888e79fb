#pragma once

#include <array>
#include <cstddef>
#include <map>
#include <string>
#include <vector>

namespace nilio::daemon {

/// Mounting of a sensor, T_base_sensor: translation (m) and fixed-axis roll, pitch, yaw (degrees, R = Rz Ry
/// Rx).
struct ExtrinsicConfig {
  std::vector<double> translation{0.0, 0.0, 0.0};
  std::vector<double> rotation_rpy_deg{0.0, 0.0, 0.0};
};

struct LidarConfig {
  std::string model = "auto";
  std::string calibration;
  std::string bind_address = "0.0.0.0";
  int port = 2368;
  int position_port = 8308;
  std::string sender_address;
  std::string multicast_group;
  std::string multicast_interface;
  int receive_buffer_bytes = 8 * 1024 * 1024;
  std::string time_source = "auto";
  double stamp_offset_us = 0.0;
  std::string return_mode = "auto";
  std::string returns = "all";
  std::string azimuth_interpolation = "auto";
  double cut_azimuth_deg = 180.0;
  double min_range_m = 2.0;
  double max_range_m = 100.0;
  double min_coverage = 0.8;
  double elevation_correction_deg = 0.0;
  ExtrinsicConfig extrinsic;
};

/// Additional LiDAR whose points are merged into the scans of the first one.
struct ExtraLidarConfig : LidarConfig {
  bool enabled = false;
  double wait_ms = 20.0;
};
inline constexpr std::size_t kMaxExtraLidars = 3;

struct ImuAxisConfig {
  std::string message;
  std::string signal;
  double scale = 1.0;
};

struct ImuSignalConfig {
  std::string message;
  std::string signal;
};

struct ImuStatusConfig {
  std::string message;
  std::string signal;
  int mask = 0x7FFFFFFF;
  int good = 0;
};

struct ImuSampleTimeConfig {
  std::string message;
  std::string signal;
  double tick_us = 1.0;
  int wrap = 0;
};

struct ImuConfig {
  bool enabled = true;
  std::string source = "auto";
  std::string preset = "auto";
  /// A DBC file with six mapped signals replaces the preset. With a preset, the scales below multiply its
  /// scales.
  std::string dbc;
  std::array<ImuAxisConfig, 3> angular_velocity;
  std::array<ImuAxisConfig, 3> linear_acceleration;
  double angular_velocity_range_deg_s = 0.0;
  double linear_acceleration_range = 0.0;
  ImuSignalConfig counter;
  ImuStatusConfig status;
  ImuSampleTimeConfig sample_time;
  ImuSignalConfig temperature;
  int source_address = -1;
  double time_offset_ms = 0.0;
  std::string interface_name;
  int bitrate = 0;
  int restart_ms = 0;
  ExtrinsicConfig extrinsic;
};

struct OdometrySection {
  int threads = 1;
  std::string registration = "ndt_icp";
  std::string coarse = "auto";
  bool calibrate_beams = true;
  int scan_points = 35000;
  int registration_points = 2000;
  double filter_voxel_m = 0.5;
  double plane_voxel_m = 0.0;
  double coarse_voxel_m = 2.0;
  double map_radius_m = 100.0;
  int map_capacity = 65536;
  int max_passes = 6;
  int max_fine_iterations = 8;
  int max_coarse_iterations = 40;
  double max_imu_gap_ms = 60.0;
  double imu_wait_ms = 20.0;
  std::string budget = "auto";
  double budget_ms = 50.0;
};

/// Parameters of the IMU-rate pose output: how corrections from new scans are applied.
struct ImuPoseSection {
  double max_slew_m_s = 1.0;
  double max_slew_deg_s = 10.0;
  double settle_ms = 100.0;
  double jump_m = 1.0;
  double jump_deg = 5.0;
  double max_age_s = 5.0;
};

struct PublisherSection {
  bool enabled = true;
  int domain = 0;
  std::vector<std::string> interfaces;
  std::string odom_frame = "odom";
  std::string base_frame = "base_link";
  std::string topic_prefix;
  bool transform = true;
  double wait_for_subscribers_s = 0.0;
  bool imu_rate = true;
  double imu_rate_max_hz = 0.0;
  int scan_points = 10'000;
  double scan_rate_max_hz = 10.0;
  int path_poses = 10'000;
  ImuPoseSection imu_pose;
};

struct RealtimeSection {
  std::string policy = "auto";
  int lidar_priority = 60;
  int imu_priority = 55;
  int odometry_priority = 40;
  int publisher_priority = 30;
  int imu_pose_priority = 20;
  /// Processors of the threads in the format of parse_cpu_list(); empty = any.
  std::string lidar_cpus;
  std::string imu_cpus;
  std::string odometry_cpus;
  bool lock_memory = true;
  bool strict = false;
};

/// Choices of a replayed ROS bag.
struct RecordingSection {
  std::string lidar_topic;
  std::string imu_topic;
  std::string base_frame;
  std::string point_times = "auto";
};

struct OutputSection {
  bool map = true;
  bool mcap = true;
};

struct MapperSection {
  double range_m = 50.0;
  int max_voxels = 200'000;
  int kept_submaps = 20;
  bool loops = true;
  std::string localise_in;
};

struct LogSection {
  std::string level = "info";
};

/// Origins of a configuration's values, kept by the functions that apply them.
struct ConfigSources {
  std::vector<std::string> files;  ///< files that were read, in this order
  /// By key: "vehicle.yaml:3", "--set" or "NILIO_LIDAR_PORT". Keys that nobody set are absent.
  std::map<std::string, std::string> origin_of;
  std::vector<std::string> warnings;
};

/// Complete configuration with its defaults. Key names, types, units and ranges: config/schema.cpp.
struct Config {
  LidarConfig lidar;
  /// Sections lidar2, lidar3, lidar4.
  std::array<ExtraLidarConfig, kMaxExtraLidars> more_lidars;
  ImuConfig imu;
  OdometrySection odometry;
  PublisherSection publisher;
  RealtimeSection realtime;
  RecordingSection recording;
  OutputSection output;
  MapperSection mapper;
  LogSection log;
  /// No value: has no effect on a run.
  ConfigSources sources;
};

}  // namespace nilio::daemon
