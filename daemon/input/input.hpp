#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/se3.hpp"
#include "nilio/drivers/bag/sources.hpp"
#include "nilio/drivers/imu/decoder.hpp"
#include "nilio/drivers/imu/detect.hpp"
#include "nilio/drivers/source.hpp"
#include "nilio/drivers/velodyne/model.hpp"

#include "daemon/config/config.hpp"
#include "daemon/input/replay_files.hpp"
#include "daemon/input/scan_feed.hpp"
#include "daemon/supervision/can_watch.hpp"

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace nilio::daemon {

/// Additional LiDAR of a run.
struct ExtraLidar {
  std::string section;  ///< "lidar2"
  ExtraLidarConfig config;
  std::unique_ptr<drivers::PacketSource> packets;
  std::optional<drivers::VelodyneSensor> sensor;  ///< as Input::sensor
};

/// Opened and validated data sources of a run.
struct Input {
  /// Either packets, or complete scans (`scans`).
  std::unique_ptr<drivers::PacketSource> packets;
  /// Sensor of the packets; empty when live, where it is identified from the packets.
  std::optional<drivers::VelodyneSensor> sensor;
  std::vector<ExtraLidar> more_lidars;
  std::unique_ptr<ScanFeed> scans;
  /// The IMU is that of the first LiDAR, an HDL-32E; there are no frames then.
  bool has_lidar_imu = false;
  /// CAN frames and their decoder; both set or both empty, unless the IMU is to be identified live: then the
  /// IMU receive thread sets the decoder.
  std::unique_ptr<drivers::FrameSource> frames;
  std::optional<drivers::ImuDecoder> imu_decoder;
  /// Live with imu.preset auto.
  std::unique_ptr<drivers::ImuIdentification> imu_identification;
  /// Recorded samples of an IMU that needs no decoder, instead of frames.
  std::unique_ptr<drivers::SampleSource> samples;
  /// Set for live frames only.
  std::unique_ptr<CanWatch> can_watch;
  /// Stamp of the recording's first packet, for paced replay.
  std::optional<core::Time> first_stamp;
  /// Set for data sets that state their poses in a camera frame.
  std::optional<core::SE3> T_camera_lidar;
  /// Mounting that the recording states; replaces the configured one.
  std::optional<ExtrinsicConfig> lidar_extrinsic;
  std::optional<ExtrinsicConfig> imu_extrinsic;
  /// Log lines: opened sources, and warnings such as a missing IMU.
  std::vector<std::string> notes;
  std::vector<std::string> warnings;
};

/// Writes the mounting that the recording states into the configuration.
void apply_extrinsics(const Input& input, Config& config);

/// Opens recorded packets of one LiDAR and identifies its sensor. `open` opens the source, `name` names it.
core::Result<std::monostate> open_recorded_packets(
    const std::function<core::Result<std::unique_ptr<drivers::PacketSource>>()>& open,
    const std::string& name, const Config& config, Input& input);

/// Applies the defaults of a recording: KITTI's elevation correction. Call before any configuration file.
void apply_recording_defaults(const ReplayFiles& files, Config& config);

/// Configuration of a replay: defaults of the recording, then its nilio.yaml, then `config_file` (empty =
/// none).
core::Result<Config> replay_config(const ReplayFiles& files, const std::string& config_file);

/// Opens a recording. Identifies each LiDAR from its first packets before playback, and reads the calibration
/// that an HDL-64E transmits. Several LiDARs in one recording are distinguished by sender_address and port.
core::Result<Input> open_replay(const ReplayFiles& files, const Config& config);
core::Result<Input> open_live(const Config& config);

/// Checks a live configuration without opening a socket: LiDARs that receive the same packets, unreadable
/// calibration and DBC files, signals that are not in them.
core::Result<std::monostate> check_live(const Config& config);

}  // namespace nilio::daemon
