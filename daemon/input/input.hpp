#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/se3.hpp"
#include "nilio/drivers/imu/decoder.hpp"
#include "nilio/drivers/source.hpp"
#include "nilio/drivers/velodyne/model.hpp"

#include "daemon/config/config.hpp"
#include "daemon/input/replay_files.hpp"
#include "daemon/input/scan_feed.hpp"
#include "daemon/output/can_watch.hpp"

#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace nilio::daemon {

/// A LiDAR beside the first one.
struct ExtraLidar {
  std::string section;  ///< "lidar2"
  ExtraLidarConfig config;
  std::unique_ptr<drivers::PacketSource> packets;
  std::optional<drivers::VelodyneSensor> sensor;  ///< as Input::sensor
};

/// What a run reads from, opened and checked.
struct Input {
  bool live = false;
  /// Either packets, or scans that are already cut.
  std::unique_ptr<drivers::PacketSource> packets;
  /// The sensor that the packets come from; nothing when live, where the packets have to tell it.
  std::optional<drivers::VelodyneSensor> sensor;
  std::vector<ExtraLidar> more_lidars;
  std::unique_ptr<ScanFeed> scans;
  /// CAN frames and what turns them into samples; both or neither.
  std::unique_ptr<drivers::FrameSource> frames;
  std::optional<drivers::ImuDecoder> imu_decoder;
  /// Set when the frames are live.
  std::unique_ptr<CanWatch> can_watch;
  /// Stamp of the recording's first packet, for playing at its own pace.
  std::optional<core::Time> first_stamp;
  /// Set for data sets whose poses are stated in a camera frame.
  std::optional<core::SE3> T_camera_lidar;
  /// One line each for the log: what is read, and warnings such as a missing IMU.
  std::vector<std::string> notes;
  std::vector<std::string> warnings;
};

/// Defaults that belong to a kind of recording; apply before any configuration file.
void apply_recording_defaults(const ReplayFiles& files, Config& config);

/// The recording's defaults, its own nilio.yaml, and `config_file` (empty = none), each over the one before.
core::Result<Config> replay_config(const ReplayFiles& files, const std::string& config_file);

/// Looks at each LiDAR's first packets before playing them: which sensor they come from, and for an HDL-64E
/// the calibration that it sends. Several LiDARs in one recording are told apart by sender_address and port.
core::Result<Input> open_replay(const ReplayFiles& files, const Config& config);
core::Result<Input> open_live(const Config& config);

}  // namespace nilio::daemon
