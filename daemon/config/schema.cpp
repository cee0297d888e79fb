#include "daemon/config/schema.hpp"

#include "nilio/core/registration_method.hpp"
#include "nilio/drivers/imu/mapping.hpp"
#include "nilio/drivers/velodyne/model.hpp"

namespace nilio::daemon {

namespace {

void add_extrinsic(std::vector<ConfigKey>& keys, const std::string& sensor, ExtrinsicConfig& extrinsic) {
  keys.push_back({sensor + ".extrinsic.translation",
                  &extrinsic.translation,
                  "position of the sensor in base_link: [x, y, z]",
                  "m",
                  -50.0,
                  50.0,
                  {}});
  keys.push_back({sensor + ".extrinsic.rotation_rpy_deg",
                  &extrinsic.rotation_rpy_deg,
                  "rotation sensor to base_link about fixed axes: [roll, pitch, yaw]",
                  "deg",
                  -360.0,
                  360.0,
                  {}});
}

std::vector<std::string> lidar_models() {
  std::vector<std::string> names{"auto"};
  for (const drivers::VelodyneModel model : drivers::velodyne_models())
    names.emplace_back(drivers::velodyne_model_name(model));
  return names;
}

/// Keys that every LiDAR has.
void add_lidar(std::vector<ConfigKey>& keys, const std::string& section, LidarConfig& c) {
  keys.push_back(
      {section + ".model", &c.model, "sensor model; auto = from the packets", "", 0, 0, lidar_models()});
  keys.push_back({section + ".calibration",
                  &c.calibration,
                  "calibration file in place of the built-in geometry",
                  "",
                  0,
                  0,
                  {}});
  keys.push_back(
      {section + ".bind_address", &c.bind_address, "local IPv4 address to receive on", "", 0, 0, {}});
  keys.push_back({section + ".port", &c.port, "UDP port of data packets", "", 1, 65535, {}});
  keys.push_back({section + ".position_port",
                  &c.position_port,
                  "UDP port of position packets; 0 = none",
                  "",
                  0,
                  65535,
                  {}});
  keys.push_back({section + ".sender_address",
                  &c.sender_address,
                  "only packets of this sender; empty = any",
                  "",
                  0,
                  0,
                  {}});
  keys.push_back({section + ".multicast_group",
                  &c.multicast_group,
                  "group that the sensor sends to; empty = none",
                  "",
                  0,
                  0,
                  {}});
  keys.push_back({section + ".multicast_interface",
                  &c.multicast_interface,
                  "address or name of the interface to join the group on; empty = the one of bind_address",
                  "",
                  0,
                  0,
                  {}});
  keys.push_back({section + ".receive_buffer_bytes",
                  &c.receive_buffer_bytes,
                  "socket receive buffer to ask for",
                  "byte",
                  65536,
                  1 << 30,
                  {}});
  keys.push_back({section + ".time_source",
                  &c.time_source,
                  "whose clock stamps the firings",
                  "",
                  0,
                  0,
                  {"auto", "sensor", "host"}});
  keys.push_back({section + ".stamp_offset_us",
                  &c.stamp_offset_us,
                  "added to every firing's time; -553 for HDL-32E firmware that stamps a packet's end",
                  "us",
                  -100000,
                  100000,
                  {}});
  keys.push_back({section + ".return_mode",
                  &c.return_mode,
                  "returns in each packet as set at the sensor; auto = from the packets",
                  "",
                  0,
                  0,
                  {"auto", "single", "dual", "dual_confidence"}});
  keys.push_back({section + ".returns",
                  &c.returns,
                  "which of two returns become points",
                  "",
                  0,
                  0,
                  {"all", "strongest", "last"}});
  keys.push_back(
      {section + ".azimuth_interpolation",
       &c.azimuth_interpolation,
       "whether the azimuth moves on from firing to firing in a block; auto = on, but off for HDL-64E",
       "",
       0,
       0,
       {"auto", "on", "off"}});
  keys.push_back({section + ".min_range_m", &c.min_range_m, "nearer returns are left out", "m", 0.1, 50, {}});
  keys.push_back({section + ".max_range_m", &c.max_range_m, "farther returns are left out", "m", 5, 300, {}});
  keys.push_back({section + ".elevation_correction_deg",
                  &c.elevation_correction_deg,
                  "raises every beam: bias of a factory calibration (0.205 for KITTI's HDL-64E)",
                  "deg",
                  -2,
                  2,
                  {}});
  add_extrinsic(keys, section, c.extrinsic);
}

/// Keys of the LiDAR whose scans decide when a pose is computed.
void add_first_lidar(std::vector<ConfigKey>& keys, LidarConfig& c) {
  add_lidar(keys, "lidar", c);
  keys.push_back({"lidar.cut_azimuth_deg",
                  &c.cut_azimuth_deg,
                  "azimuth at which scans are cut; 0 = forward, clockwise",
                  "deg",
                  0,
                  359.99,
                  {}});
  keys.push_back({"lidar.min_coverage",
                  &c.min_coverage,
                  "scans that cover a smaller share of the sensor's field of view are dropped and counted",
                  "",
                  0.05,
                  1.0,
                  {}});
}

/// Keys of a LiDAR whose points are added to the scans of the first.
void add_extra_lidar(std::vector<ConfigKey>& keys, const std::string& section, ExtraLidarConfig& c) {
  keys.push_back({section + ".enabled", &c.enabled, "use this LiDAR, too", "", 0, 0, {}});
  keys.push_back({section + ".wait_ms",
                  &c.wait_ms,
                  "live: how long a complete scan waits for this LiDAR's packets",
                  "ms",
                  0,
                  1000,
                  {}});
  add_lidar(keys, section, c);
}

/// What a mapping may have beside the six axes.
void add_imu_signals(std::vector<ConfigKey>& keys, ImuConfig& c) {
  const auto add_signal = [&](const std::string& name, const std::string& what, std::string& message,
                              std::string& signal) {
    keys.push_back({"imu." + name + ".message", &message, "DBC message of " + what, "", 0, 0, {}});
    keys.push_back({"imu." + name + ".signal", &signal, "DBC signal of " + what, "", 0, 0, {}});
  };
  keys.push_back({"imu.angular_velocity_range_deg_s",
                  &c.angular_velocity_range_deg_s,
                  "rates from here on are saturated; 0 = only those at the end of their bits",
                  "deg/s",
                  0,
                  10000,
                  {}});
  keys.push_back({"imu.linear_acceleration_range",
                  &c.linear_acceleration_range,
                  "accelerations from here on are saturated; 0 = only those at the end of their bits",
                  "m/s^2",
                  0,
                  10000,
                  {}});
  add_signal("counter", "the sample's number", c.counter.message, c.counter.signal);
  add_signal("status", "the status, without which samples are dropped", c.status.message, c.status.signal);
  keys.push_back({"imu.status.mask", &c.status.mask, "bits of the status that count", "", 0, 0x7FFFFFFF, {}});
  keys.push_back({"imu.status.good", &c.status.good, "their value in a good sample", "", 0, 0x7FFFFFFF, {}});
  add_signal("sample_time", "the device's time", c.sample_time.message, c.sample_time.signal);
  keys.push_back({"imu.sample_time.tick_us", &c.sample_time.tick_us, "its tick", "us", 0.001, 1e6, {}});
  keys.push_back({"imu.sample_time.wrap",
                  &c.sample_time.wrap,
                  "ticks after which it begins again; 0 = when its bits are used up",
                  "",
                  0,
                  0x7FFFFFFF,
                  {}});
  add_signal("temperature", "the temperature", c.temperature.message, c.temperature.signal);
}

/// The signals of a DBC file in place of a preset.
void add_imu_mapping(std::vector<ConfigKey>& keys, ImuConfig& c) {
  const std::array<std::string, 3> axes = {"x", "y", "z"};
  for (std::size_t i = 0; i < 3; ++i) {
    const auto add_axis = [&](const std::string& quantity, const std::string& unit, ImuAxisConfig& axis) {
      const std::string path = "imu." + quantity + "_" + axes[i];
      keys.push_back({path + ".message", &axis.message, "DBC message that carries it", "", 0, 0, {}});
      keys.push_back({path + ".signal", &axis.signal, "DBC signal that carries it", "", 0, 0, {}});
      keys.push_back({path + ".scale",
                      &axis.scale,
                      "from the signal's unit and axis to " + unit +
                          ", x forward, y left, z up; multiplies the preset's",
                      "",
                      0,
                      0,
                      {}});
    };
    add_axis("angular_velocity", "rad/s", c.angular_velocity[i]);
    add_axis("linear_acceleration", "m/s^2", c.linear_acceleration[i]);
  }
  add_imu_signals(keys, c);
}

void add_imu(std::vector<ConfigKey>& keys, ImuConfig& c) {
  keys.push_back({"imu.enabled",
                  &c.enabled,
                  "use an IMU; without one the motion is taken to be constant",
                  "",
                  0,
                  0,
                  {}});
  keys.push_back(
      {"imu.preset", &c.preset, "built-in DBC and signal mapping", "", 0, 0, drivers::imu_preset_names()});
  keys.push_back(
      {"imu.dbc", &c.dbc, "DBC file in place of the preset; then map all six signals", "", 0, 0, {}});
  keys.push_back({"imu.interface",
                  &c.interface_name,
                  "CAN interface of the IMU, such as can0; empty = none live, all of a log",
                  "",
                  0,
                  0,
                  {}});
  keys.push_back({"imu.bitrate",
                  &c.bitrate,
                  "bit rate to set the interface to, live; 0 = leave it as it is",
                  "bit/s",
                  0,
                  1'000'000,
                  {}});
  keys.push_back(
      {"imu.restart_ms",
       &c.restart_ms,
       "set with the bit rate: the controller restarts itself so long after bus-off; 0 = niliod does",
       "ms",
       0,
       60'000,
       {}});
  keys.push_back({"imu.source_address",
                  &c.source_address,
                  "SAE J1939 only: address of the IMU; -1 = the first that sends its messages",
                  "",
                  -1,
                  253,
                  {}});
  keys.push_back({"imu.time_offset_ms",
                  &c.time_offset_ms,
                  "subtracted from the IMU's stamps; positive = they are later than the LiDAR's",
                  "ms",
                  -1000,
                  1000,
                  {}});
  add_imu_mapping(keys, c);
  add_extrinsic(keys, "imu", c.extrinsic);
}

void add_odometry(std::vector<ConfigKey>& keys, OdometrySection& c) {
  keys.push_back(
      {"odometry.threads", &c.threads, "threads of registration; does not change the result", "", 1, 64, {}});
  std::vector<std::string> methods;
  for (const core::RegistrationMethod method : core::kRegistrationMethods)
    methods.emplace_back(core::name_of(method));
  keys.push_back({"odometry.registration", &c.registration,
                  "how scans are registered: NDT coarse and point-to-plane ICP fine, or one metric alone", "",
                  0, 0, methods});
  keys.push_back({"odometry.coarse",
                  &c.coarse,
                  "when NDT runs before ICP: when needed, or before every ICP as in the paper",
                  "",
                  0,
                  0,
                  {"auto", "always"}});
  keys.push_back(
      {"odometry.scan_points",
       &c.scan_points,
       "points of a scan that are looked at, spread evenly over it; icp_line and icp_point look at all",
       "",
       2000,
       10000000,
       {}});
  keys.push_back({"odometry.registration_points",
                  &c.registration_points,
                  "points that registration uses",
                  "",
                  100,
                  20000,
                  {}});
  keys.push_back({"odometry.filter_voxel_m",
                  &c.filter_voxel_m,
                  "voxel of the points that feed the map",
                  "m",
                  0.1,
                  5,
                  {}});
  keys.push_back({"odometry.plane_voxel_m",
                  &c.plane_voxel_m,
                  "voxel of the planes; 0 = from the sensor's beam spacing",
                  "m",
                  0,
                  10,
                  {}});
  keys.push_back({"odometry.coarse_voxel_m", &c.coarse_voxel_m, "voxel of the NDT", "m", 0.5, 20, {}});
  keys.push_back(
      {"odometry.map_radius_m", &c.map_radius_m, "the map is kept to this distance", "m", 20, 500, {}});
  keys.push_back(
      {"odometry.map_capacity", &c.map_capacity, "plane voxels the map can hold", "", 1000, 10000000, {}});
  keys.push_back(
      {"odometry.max_passes", &c.max_passes, "deskew, register, repeat: at most so often", "", 1, 10, {}});
  keys.push_back(
      {"odometry.max_fine_iterations", &c.max_fine_iterations, "ICP iterations a pass", "", 1, 100, {}});
  keys.push_back({"odometry.max_coarse_iterations",
                  &c.max_coarse_iterations,
                  "NDT iterations a kernel scale",
                  "",
                  1,
                  100,
                  {}});
  keys.push_back({"odometry.max_imu_gap_ms",
                  &c.max_imu_gap_ms,
                  "a longer gap between samples is not bridged",
                  "ms",
                  1,
                  1000,
                  {}});
  keys.push_back({"odometry.imu_wait_ms",
                  &c.imu_wait_ms,
                  "live: how long a complete scan waits for its IMU samples",
                  "ms",
                  0,
                  1000,
                  {}});
  keys.push_back({"odometry.budget",
                  &c.budget,
                  "what limits the time of a scan: the clock, counted work (the same result everywhere), "
                  "nothing; auto = wall when live, off in a replay",
                  "",
                  0,
                  0,
                  {"auto", "wall", "ops", "off"}});
  keys.push_back({"odometry.budget_ms",
                  &c.budget_ms,
                  "from the arrival of a scan's last packet to its pose",
                  "ms",
                  0.2,
                  1000,
                  {}});
}

void add_imu_rate(std::vector<ConfigKey>& keys, Config& c) {
  PublisherSection& publisher = c.publisher;
  ImuPoseSection& pose = publisher.imu_pose;
  const auto add = [&](const char* name, auto* value, const char* text, const char* unit, double min,
                       double max) {
    keys.push_back({name, value, text, unit, min, max, {}});
  };
  add("publisher.imu_rate", &publisher.imu_rate,
      "publish a pose for every IMU sample, too; not in a replay as fast as possible", "", 0, 0);
  add("publisher.imu_rate_max_hz", &publisher.imu_rate_max_hz, "leave samples out above it; 0 = none", "Hz",
      0, 10000);
  add("publisher.imu_pose.max_slew_m_s", &pose.max_slew_m_s,
      "speed with which a correction of the position is worked off", "m/s", 0.01, 100);
  add("publisher.imu_pose.max_slew_deg_s", &pose.max_slew_deg_s, "the same of the orientation", "deg/s", 0.1,
      1000);
  add("publisher.imu_pose.settle_ms", &pose.settle_ms, "time constant of a correction below these limits",
      "ms", 0, 10000);
  add("publisher.imu_pose.jump_m", &pose.jump_m, "a larger correction is made at once, and said to be", "m",
      0, 1000);
  add("publisher.imu_pose.jump_deg", &pose.jump_deg, "the same of the orientation", "deg", 0, 180);
  add("publisher.imu_pose.max_age_s", &pose.max_age_s, "no such poses so long after the last scan's", "s",
      0.1, 60);
}

void add_rest(std::vector<ConfigKey>& keys, Config& c) {
  keys.push_back({"publisher.enabled", &c.publisher.enabled, "publish over DDS", "", 0, 0, {}});
  keys.push_back({"publisher.domain", &c.publisher.domain, "DDS domain (ROS_DOMAIN_ID)", "", 0, 232, {}});
  keys.push_back({"publisher.interfaces",
                  &c.publisher.interfaces,
                  "IPv4 addresses DDS may use; empty = all",
                  "",
                  0,
                  0,
                  {}});
  keys.push_back({"publisher.odom_frame", &c.publisher.odom_frame, "frame of the poses", "", 0, 0, {}});
  keys.push_back(
      {"publisher.base_frame", &c.publisher.base_frame, "frame that the poses are of", "", 0, 0, {}});
  keys.push_back(
      {"publisher.topic_prefix", &c.publisher.topic_prefix, "put before the topic names", "", 0, 0, {}});
  keys.push_back({"publisher.wait_for_subscribers_s",
                  &c.publisher.wait_for_subscribers_s,
                  "hold the first poses until somebody listens, at most so long",
                  "s",
                  0,
                  60,
                  {}});
  add_imu_rate(keys, c);
  keys.push_back({"realtime.policy",
                  &c.realtime.policy,
                  "scheduling of the threads; auto = fifo when live, other in a replay",
                  "",
                  0,
                  0,
                  {"auto", "fifo", "other"}});
  keys.push_back({"realtime.lidar_priority",
                  &c.realtime.lidar_priority,
                  "FIFO priority of the LiDAR receive thread",
                  "",
                  1,
                  99,
                  {}});
  keys.push_back({"realtime.imu_priority",
                  &c.realtime.imu_priority,
                  "FIFO priority of the IMU receive thread",
                  "",
                  1,
                  99,
                  {}});
  keys.push_back({"realtime.odometry_priority",
                  &c.realtime.odometry_priority,
                  "FIFO priority of the odometry thread",
                  "",
                  1,
                  99,
                  {}});
  keys.push_back({"realtime.imu_pose_priority",
                  &c.realtime.imu_pose_priority,
                  "FIFO priority of nilio-publisher's thread of poses at IMU rate",
                  "",
                  1,
                  99,
                  {}});
  keys.push_back({"realtime.lidar_cpus",
                  &c.realtime.lidar_cpus,
                  "processors of the LiDAR receive threads, such as 0 or 1-2,4; empty = any",
                  "",
                  0,
                  0,
                  {}});
  keys.push_back({"realtime.imu_cpus",
                  &c.realtime.imu_cpus,
                  "processors of the IMU receive thread; empty = any",
                  "",
                  0,
                  0,
                  {}});
  keys.push_back({"realtime.odometry_cpus",
                  &c.realtime.odometry_cpus,
                  "processors of the odometry thread and its workers; empty = any",
                  "",
                  0,
                  0,
                  {}});
  keys.push_back(
      {"realtime.lock_memory", &c.realtime.lock_memory, "lock all memory when live", "", 0, 0, {}});
  keys.push_back({"realtime.strict",
                  &c.realtime.strict,
                  "end when a wanted privilege or processor is missing",
                  "",
                  0,
                  0,
                  {}});
  keys.push_back({"output.map", &c.output.map, "write map.ply into the output folder", "", 0, 0, {}});
  keys.push_back({"output.map_voxel_m",
                  &c.output.map_voxel_m,
                  "one point of map.ply in so large a voxel",
                  "m",
                  0.05,
                  10,
                  {}});
  keys.push_back({"log.level",
                  &c.log.level,
                  "least severe message to print",
                  "",
                  0,
                  0,
                  {"debug", "info", "warn", "error"}});
}

}  // namespace

std::string extra_lidar_section(std::size_t index) { return "lidar" + std::to_string(index + 2); }

std::vector<ConfigKey> config_keys(Config& config) {
  std::vector<ConfigKey> keys;
  add_first_lidar(keys, config.lidar);
  for (std::size_t i = 0; i < kMaxExtraLidars; ++i)
    add_extra_lidar(keys, extra_lidar_section(i), config.more_lidars[i]);
  add_imu(keys, config.imu);
  add_odometry(keys, config.odometry);
  add_rest(keys, config);
  return keys;
}

}  // namespace nilio::daemon
