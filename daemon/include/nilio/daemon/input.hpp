#pragma once

#include "nilio/core/odometry.hpp"
#include "nilio/core/result.hpp"
#include "nilio/core/se3.hpp"
#include "nilio/daemon/can_watch.hpp"
#include "nilio/daemon/config.hpp"
#include "nilio/daemon/scan_feed.hpp"
#include "nilio/drivers/imu_decoder.hpp"
#include "nilio/drivers/source.hpp"
#include "nilio/drivers/velodyne_decoder.hpp"

#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace nilio::daemon {

/// What a run reads from, opened and checked.
struct Input {
  bool live = false;
  /// Either packets with the sensor they come from, or scans that are already cut.
  std::unique_ptr<drivers::PacketSource> packets;
  std::optional<drivers::VelodyneSensor> sensor;
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

/// The parts of a replay found on the command line.
struct ReplayFiles {
  std::vector<std::string> captures;  ///< pcap or pcapng, in order; several are parts of one recording
  std::vector<std::string> can_logs;  ///< candump, in order
  std::string configuration;          ///< nilio.yaml that came with the recording
  std::string kitti_sequence;         ///< folder
};

/// Sorts folders and files by what they are. The numbered files that `nilio record` writes (lidar_0001.pcap,
/// can_0001.log) are parts of one recording, in the order of their numbers. Fails when more than one of a
/// kind is there otherwise, naming them.
core::Result<ReplayFiles> sort_replay_files(const std::vector<std::string>& paths);
/// As sort_replay_files(); fails also without a capture or a KITTI sequence.
core::Result<ReplayFiles> find_replay_files(const std::vector<std::string>& paths);

/// Defaults that belong to a kind of recording; apply before any configuration file.
void apply_recording_defaults(const ReplayFiles& files, Config& config);

core::Result<Input> open_replay(const ReplayFiles& files, const Config& config);
core::Result<Input> open_live(const Config& config);

/// Configuration in the core's and the drivers' own terms.
core::OdometryConfig odometry_config(const Config& config);
drivers::ScanAssemblerConfig assembler_config(const Config& config);

}  // namespace nilio::daemon
