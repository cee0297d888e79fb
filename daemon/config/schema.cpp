#include "daemon/config/schema.hpp"

#include "nilio/core/odometry_config.hpp"
#include "nilio/drivers/bag/point_cloud.hpp"
#include "nilio/drivers/imu/mapping.hpp"
#include "nilio/drivers/velodyne/model.hpp"

#include "ipc/publisher_process.hpp"

#include <algorithm>
#include <array>
#include <string_view>
#include <utility>

namespace nilio::daemon {

namespace {

using Names = std::vector<std::string>;

/// Keys that differ from vehicle to vehicle: the content of config/vehicle.yaml.
constexpr std::array<std::string_view, 8> kBasicKeys = {"lidar.min_range_m",
                                                        "lidar.extrinsic.translation",
                                                        "lidar.extrinsic.rotation_rpy_deg",
                                                        "imu.preset",
                                                        "imu.interface",
                                                        "imu.extrinsic.translation",
                                                        "imu.extrinsic.rotation_rpy_deg",
                                                        "publisher.domain"};

/// The threads of a run copy their configuration when they start; only the log reads its level at each line.
constexpr std::array<std::string_view, 1> kAppliedKeys = {"log.level"};

/// Adds the keys below one section path to the table.
class Section {
 public:
  Section(std::vector<ConfigKey>& keys, std::string path) : keys_(keys), path_(std::move(path)) {}

  [[nodiscard]] Section below(const std::string& name) const { return {keys_, path_ + "." + name}; }

  /// Flag, list of texts, or free text.
  void add(const char* name, ConfigKey::Target target, const std::string& help) {
    keys_.push_back({.path = path_ + "." + name, .target = target, .help = help});
  }
  void choice(const char* name, std::string& target, Names allowed, const char* help) {
    add(name, &target, help);
    keys_.back().allowed = std::move(allowed);
  }
  /// Number (or three) from `min` to `max`; equal limits allow any finite number.
  void number(const char* name, ConfigKey::Target target, const char* unit, double min, double max,
              const std::string& help) {
    add(name, target, help);
    keys_.back().unit = unit;
    keys_.back().minimum = min;
    keys_.back().maximum = max;
  }

 private:
  std::vector<ConfigKey>& keys_;
  std::string path_;
};

void add_extrinsic(Section sensor, ExtrinsicConfig& c) {
  Section s = sensor.below("extrinsic");
  s.number("translation", &c.translation, "m", -50, 50, "position of the sensor in base_link: [x, y, z]");
  s.number("rotation_rpy_deg", &c.rotation_rpy_deg, "deg", -360, 360,
           "rotation from the sensor frame to base_link about fixed axes: [roll, pitch, yaw]");
}

/// Keys of every LiDAR.
void add_lidar(Section s, LidarConfig& c) {
  Names models{"auto"};
  for (const drivers::VelodyneModel model : drivers::velodyne_models())
    models.emplace_back(drivers::velodyne_model_name(model));
  s.choice("model", c.model, models, "sensor model; auto = identified from the packets");
  s.add("calibration", &c.calibration, "calibration file; empty = transmitted or built-in calibration");
  s.add("bind_address", &c.bind_address, "local IPv4 address to receive on");
  s.number("port", &c.port, "", 1, 65535, "UDP port of data packets");
  s.number("position_port", &c.position_port, "", 0, 65535, "UDP port of position packets; 0 = none");
  s.add("sender_address", &c.sender_address,
        "accept packets of this sender only; empty = the first that sends as steadily as a sensor");
  s.add("multicast_group", &c.multicast_group, "multicast group the sensor sends to; empty = none");
  s.add("multicast_interface", &c.multicast_interface,
        "address or name of the interface that joins the group; empty = that of bind_address");
  s.number("receive_buffer_bytes", &c.receive_buffer_bytes, "byte", 65536, 1 << 30,
           "requested receive buffer of the socket");
  s.choice("time_source", c.time_source, {"auto", "sensor", "host"},
           "clock of the firing times; auto = sensor clock, mapped to host time if the two disagree");
  s.number("stamp_offset_us", &c.stamp_offset_us, "us", -100000, 100000,
           "offset added to all firing times; -553 for HDL-32E firmware that stamps the packet's end");
  s.choice(
      "return_mode", c.return_mode, {"auto", "single", "dual", "dual_confidence"},
      "return mode of the sensor; auto = identified from the packets; another mode than theirs is an error");
  s.choice("returns", c.returns, {"all", "strongest", "last"}, "returns used as points in dual return mode");
  s.choice("azimuth_interpolation", c.azimuth_interpolation, {"auto", "on", "off"},
           "interpolate the azimuth between the firings of a block; auto = on, HDL-64E: off");
  s.number("min_range_m", &c.min_range_m, "m", 0.1, 50, "minimum range of points");
  s.number("max_range_m", &c.max_range_m, "m", 5, 300, "maximum range of points");
  s.number("elevation_correction_deg", &c.elevation_correction_deg, "deg", -2, 2,
           "correction added to the elevation of all beams (0.205 for the HDL-64E of KITTI)");
  add_extrinsic(s, c.extrinsic);
}

/// Keys of the LiDAR that triggers the poses.
void add_first_lidar(Section s, LidarConfig& c) {
  add_lidar(s, c);
  s.number("cut_azimuth_deg", &c.cut_azimuth_deg, "deg", 0, 359.99,
           "azimuth at which scans are cut; 0 = forward, clockwise");
  s.number(
      "min_coverage", &c.min_coverage, "", 0.05, 1.0,
      "minimum share of the field of view that a scan surrounds, thinned out by lost packets or not; other "
      "scans are dropped and counted");
}

/// Keys of a LiDAR whose points are merged into the scans of the first.
void add_extra_lidar(Section s, ExtraLidarConfig& c) {
  s.add("enabled", &c.enabled, "merge the points of this LiDAR into the scans of the first one");
  s.number("wait_ms", &c.wait_ms, "ms", 0, 1000,
           "live: maximum wait of a complete scan for packets of this LiDAR");
  add_lidar(s, c);
}

void add_imu(Section s, ImuConfig& c) {
  s.add("enabled", &c.enabled, "use an IMU; without one, constant velocity is predicted");
  s.choice("source", c.source, {"auto", "can", "hdl32e"},
           "IMU on CAN, or the one in an HDL-32E (position packets; at lidar.extrinsic); auto = CAN where an "
           "interface is configured or frames are recorded, otherwise the HDL-32E's");
  Names presets{"auto"};
  for (const std::string& name : drivers::imu_preset_names()) presets.push_back(name);
  s.choice("preset", c.preset, presets,
           "built-in DBC file and signal mapping; auto = identified from the first second of frames");
  s.add("dbc", &c.dbc, "DBC file instead of the preset; requires a mapping of all six axes");
  s.add("interface", &c.interface_name,
        "CAN interface of the IMU, such as can0; empty = no IMU live, all interfaces of a log");
  s.number("bitrate", &c.bitrate, "bit/s", 0, 1'000'000,
           "live: bit rate set on the interface; 0 = unchanged");
  s.number("restart_ms", &c.restart_ms, "ms", 0, 60'000,
           "with bitrate: restart delay of the controller after bus-off; 0 = restart by niliod");
  s.number("source_address", &c.source_address, "", -1, 253,
           "SAE J1939: address of the IMU; -1 = first sender of its messages");
  s.number("time_offset_ms", &c.time_offset_ms, "ms", -1000, 1000,
           "time offset subtracted from IMU stamps; positive = stamps later than those of the LiDAR");
  const std::array<std::string, 3> axes = {"x", "y", "z"};
  for (std::size_t i = 0; i < axes.size(); ++i) {
    const auto add_axis = [&](const std::string& quantity, const std::string& unit, ImuAxisConfig& axis) {
      Section a = s.below(quantity + "_" + axes[i]);
      a.add("message", &axis.message, "DBC message of this axis");
      a.add("signal", &axis.signal, "DBC signal of this axis");
      a.number("scale", &axis.scale, "", 0, 0,
               "factor from the signal to " + unit +
                   " (x forward, y left, z up); with a preset, multiplied by the preset's factor");
    };
    add_axis("angular_velocity", "rad/s", c.angular_velocity[i]);
    add_axis("linear_acceleration", "m/s^2", c.linear_acceleration[i]);
  }
  s.number("angular_velocity_range_deg_s", &c.angular_velocity_range_deg_s, "deg/s", 0, 10000,
           "full scale of the gyro for saturation; 0 = limits of the signal");
  s.number("linear_acceleration_range", &c.linear_acceleration_range, "m/s^2", 0, 10000,
           "full scale of the accelerometer for saturation; 0 = limits of the signal");
  const auto add_signal = [&](const char* name, const std::string& content, auto& signal) {
    Section a = s.below(name);
    a.add("message", &signal.message, "DBC message of " + content);
    a.add("signal", &signal.signal, "DBC signal of " + content);
    return a;
  };
  add_signal("counter", "the sample counter", c.counter);
  Section status = add_signal("status", "the status word; samples without it are dropped", c.status);
  status.number("mask", &c.status.mask, "", 0, 0x7FFFFFFF, "evaluated bits of the status word");
  status.number("good", &c.status.good, "", 0, 0x7FFFFFFF, "value of these bits in a valid sample");
  Section time = add_signal("sample_time", "the device time", c.sample_time);
  time.number("tick_us", &c.sample_time.tick_us, "us", 0.001, 1e6, "period of the device time's tick");
  time.number("wrap", &c.sample_time.wrap, "", 0, 0x7FFFFFFF,
              "ticks after which the device time wraps to 0; 0 = full range of the signal");
  add_signal("temperature", "the temperature", c.temperature);
  add_extrinsic(s, c.extrinsic);
}

void add_odometry(Section s, OdometrySection& c) {
  Names methods;
  for (const core::RegistrationMethod method : core::kRegistrationMethods)
    methods.emplace_back(core::name_of(method));
  s.number("threads", &c.threads, "", 1, 64, "threads of the registration; does not change the result");
  s.choice("registration", c.registration, methods,
           "registration method: NDT followed by point-to-plane ICP, or a single metric");
  s.choice("coarse", c.coarse, {"auto", "always"},
           "use of NDT before ICP: on demand, or before every ICP as in the paper");
  s.add("calibrate_beams", &c.calibrate_beams,
        "find the errors of each beam in range, elevation and azimuth while driving; not of merged LiDARs");
  s.number("scan_points", &c.scan_points, "", 2000, 10000000,
           "maximum points of a scan to process, evenly distributed; icp_line and icp_point use all");
  s.number("registration_points", &c.registration_points, "", 100, 20000, "points used by registration");
  s.number("filter_voxel_m", &c.filter_voxel_m, "m", 0.1, 5, "voxel size of the points for the map");
  s.number("plane_voxel_m", &c.plane_voxel_m, "m", 0, 10,
           "voxel size of the plane map; 0 = from the sensor's beam spacing");
  s.number("coarse_voxel_m", &c.coarse_voxel_m, "m", 0.5, 20, "voxel size of the NDT map");
  s.number("map_radius_m", &c.map_radius_m, "m", 20, 500, "radius of the local map");
  s.number("map_capacity", &c.map_capacity, "", 1000, 10000000, "maximum voxels of the plane map");
  s.number("max_passes", &c.max_passes, "", 1, 10, "maximum passes of deskewing and registration");
  s.number("max_fine_iterations", &c.max_fine_iterations, "", 1, 100, "maximum ICP iterations per pass");
  s.number("max_coarse_iterations", &c.max_coarse_iterations, "", 1, 100,
           "maximum NDT iterations per kernel scale");
  s.number("max_imu_gap_ms", &c.max_imu_gap_ms, "ms", 1, 1000,
           "maximum gap between IMU samples that is interpolated");
  s.number("imu_wait_ms", &c.imu_wait_ms, "ms", 0, 1000,
           "live: maximum wait of a complete scan for its IMU samples");
  s.choice("budget", c.budget, {"auto", "wall", "ops", "off"},
           "limit of a scan's computing time: by the clock (wall), by counted work with the same result on "
           "every computer (ops), none (off); auto = wall when live, off in a replay");
  s.number("budget_ms", &c.budget_ms, "ms", 0.2, 1000, "deadline of a pose after the scan's last packet");
}

void add_publisher(Section s, PublisherSection& c) {
  s.add("enabled", &c.enabled, "publish over DDS");
  s.number("domain", &c.domain, "", 0, 232, "DDS domain (ROS_DOMAIN_ID)");
  s.add("interfaces", &c.interfaces, "IPv4 addresses that DDS uses; empty = all");
  s.add("odom_frame", &c.odom_frame, "reference frame of the poses");
  s.add("base_frame", &c.base_frame, "vehicle frame of the poses");
  s.add("topic_prefix", &c.topic_prefix, "prefix of the topic names");
  s.add("transform", &c.transform,
        "publish the transform from odom_frame to base_frame; false where another node does, such as "
        "robot_localization");
  s.number("wait_for_subscribers_s", &c.wait_for_subscribers_s, "s", 0, 60,
           "maximum time the first poses wait for a subscriber");
  s.add("imu_rate", &c.imu_rate, "also publish a pose for every IMU sample; not in an unpaced replay");
  s.number("imu_rate_max_hz", &c.imu_rate_max_hz, "Hz", 0, 10000,
           "maximum rate of these poses; 0 = one per sample");
  s.number("scan_points", &c.scan_points, "", 0, ipc::ScanCloud::kCapacity,
           "maximum points of a registered scan; 0 = no registered scans");
  s.number("scan_rate_max_hz", &c.scan_rate_max_hz, "Hz", 0.1, 1000, "maximum rate of registered scans");
  s.number("path_poses", &c.path_poses, "", 0, ipc::kMaxPathPoses,
           "maximum poses of the path, about one per metre, the newest; 0 = no path");
  Section pose = s.below("imu_pose");
  ImuPoseSection& p = c.imu_pose;
  pose.number("max_slew_m_s", &p.max_slew_m_s, "m/s", 0.01, 100, "maximum slew rate of position corrections");
  pose.number("max_slew_deg_s", &p.max_slew_deg_s, "deg/s", 0.1, 1000,
              "maximum slew rate of orientation corrections");
  pose.number("settle_ms", &p.settle_ms, "ms", 0, 10000, "time constant of corrections below these limits");
  pose.number("jump_m", &p.jump_m, "m", 0, 1000,
              "larger position corrections are applied at once and reported as a jump");
  pose.number("jump_deg", &p.jump_deg, "deg", 0, 180, "larger orientation corrections are applied at once");
  pose.number("max_age_s", &p.max_age_s, "s", 0.1, 60, "maximum propagation time after the last scan");
}

void add_realtime(Section s, RealtimeSection& c) {
  s.choice("policy", c.policy, {"auto", "fifo", "other"},
           "scheduling of the threads; auto = fifo when live, other in a replay");
  s.number("lidar_priority", &c.lidar_priority, "", 1, 99, "FIFO priority of the LiDAR receive threads");
  s.number("imu_priority", &c.imu_priority, "", 1, 99, "FIFO priority of the IMU receive thread");
  s.number("odometry_priority", &c.odometry_priority, "", 1, 99, "FIFO priority of the odometry thread");
  s.number("publisher_priority", &c.publisher_priority, "", 1, 99,
           "FIFO priority of nilio-publisher's scan pose thread");
  s.number("imu_pose_priority", &c.imu_pose_priority, "", 1, 99,
           "FIFO priority of nilio-publisher's IMU-rate pose thread");
  s.add("lidar_cpus", &c.lidar_cpus, "CPUs of the LiDAR receive threads, such as 0 or 1-2,4; empty = any");
  s.add("imu_cpus", &c.imu_cpus, "CPUs of the IMU receive thread; empty = any");
  s.add("odometry_cpus", &c.odometry_cpus, "CPUs of the odometry thread and its workers; empty = any");
  s.add("lock_memory", &c.lock_memory, "lock all memory when live");
  s.add("strict", &c.strict, "exit if a required privilege or CPU is missing");
}

void add_recording(Section s, RecordingSection& c) {
  s.add("lidar_topic", &c.lidar_topic, "ROS bag: topic of packets or point clouds; empty = the only one");
  s.add("imu_topic", &c.imu_topic,
        "ROS bag: topic of sensor_msgs/Imu or can_msgs/Frame; empty = the only one");
  s.add("base_frame", &c.base_frame,
        "ROS bag: frame of /tf_static that is base_link and places LiDAR and IMU; empty = the LiDAR's frame, "
        "unless an extrinsic is configured");
  const auto names = drivers::point_times_names();
  s.choice("point_times", c.point_times, {names.begin(), names.end()},
           "point clouds: what the header's stamp is the time of (start, middle, end of the sweep), times by "
           "azimuth, "
           "or none; auto = recognised from the data");
}

}  // namespace

std::string extra_lidar_section(std::size_t index) { return "lidar" + std::to_string(index + 2); }

std::vector<ConfigKey> config_keys(Config& config) {
  std::vector<ConfigKey> keys;
  add_first_lidar({keys, "lidar"}, config.lidar);
  for (std::size_t i = 0; i < kMaxExtraLidars; ++i)
    add_extra_lidar({keys, extra_lidar_section(i)}, config.more_lidars[i]);
  add_imu({keys, "imu"}, config.imu);
  add_odometry({keys, "odometry"}, config.odometry);
  add_publisher({keys, "publisher"}, config.publisher);
  add_realtime({keys, "realtime"}, config.realtime);
  add_recording({keys, "recording"}, config.recording);
  Section output(keys, "output");
  output.add("map", &config.output.map,
             "write the folder map and its export map.ply (nilio-mapper) into the output folder");
  output.add("run_mcap", &config.output.mcap,
             "write run.mcap into the output folder: poses, path, thinned scans, submaps, diagnostics");
  Section mapper(keys, "mapper");
  mapper.number("range_m", &config.mapper.range_m, "m", 5, 65,
                "points farther from their sensor are not mapped");
  mapper.number("max_voxels", &config.mapper.max_voxels, "", 1000, 2'000'000,
                "maximum voxels of an open submap, about 0.12 kB each; three are open");
  mapper.number("kept_submaps", &config.mapper.kept_submaps, "", 1, 1000,
                "submaps that DDS keeps for late subscribers, about 1 MB each");
  mapper.add(
      "loops", &config.mapper.loops,
      "close loops while the run goes on: corrects the poses of the submaps and map -> odom, not odom");
  mapper.add("localise_in", &config.mapper.localise_in,
             "folder of a map to localise in, which gives map -> odom; empty = none. The map is only read");
  Section(keys, "log")
      .choice("level", config.log.level, {"debug", "info", "warn", "error"},
              "minimum severity of printed messages");
  for (ConfigKey& key : keys) {
    if (std::ranges::find(kBasicKeys, key.path) != kBasicKeys.end()) key.level = KeyLevel::kBasic;
    if (std::ranges::find(kAppliedKeys, key.path) != kAppliedKeys.end()) key.reload = ReloadClass::kApplied;
  }
  return keys;
}

}  // namespace nilio::daemon
