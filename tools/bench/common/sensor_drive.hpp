#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/time.hpp"

#include "daemon/config/config.hpp"
#include "daemon/input/replay_files.hpp"
#include "tools/evaluate/trajectory.hpp"

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace nilio::tools {

/// A recording of packets to be sent again, and where the vehicle really was if that is known.
struct SensorDrive {
  std::string name;  ///< last part of the folder, or the capture's name
  daemon::ReplayFiles files;
  std::optional<Trajectory> truth;
  /// The recording's own: its ports, and whether there is an IMU.
  daemon::Config config;
};

/// `argument` is a folder or a capture, whose truth is truth.tum in the folder, or ARGUMENT:TRUTH. Fails for
/// what has no packets to send, or those of several LiDARs.
core::Result<SensorDrive> open_sensor_drive(const std::string& argument);
/// All of them, in order, or the error of the first that fails.
core::Result<std::vector<SensorDrive>> open_sensor_drives(const std::vector<std::string>& arguments);

/// The beginning of a drive in files of its own.
struct DrivePart {
  daemon::ReplayFiles files;
  std::uint64_t packets = 0;
  core::Time first_stamp;
  core::Duration length;
};

/// Writes what was received in the first `length` of the drive to lidar.pcap and, if there is a CAN log,
/// imu.candump.log in `folder`, which has to exist. The configuration stays where it is.
core::Result<DrivePart> write_beginning(const SensorDrive& drive, core::Duration length,
                                        const std::filesystem::path& folder);

}  // namespace nilio::tools
