#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/time.hpp"

#include "daemon/config/config.hpp"
#include "daemon/input/replay_files.hpp"
#include "tools/common/trajectory.hpp"

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace nilio::tools::bench {

/// A recording of packets to be sent again, with the true trajectory if there is one.
struct SensorDrive {
  std::string name;  ///< last part of the folder, or the capture's name
  daemon::ReplayFiles files;
  std::optional<Trajectory> truth;
  daemon::Config config;  ///< of the recording: ports, and whether there is an IMU
};

/// Opens a folder or a capture; its truth is truth.tum in the folder, or TRUTH of "ARGUMENT:TRUTH". Fails for
/// recordings without packets and for those of several LiDARs.
core::Result<SensorDrive> open_sensor_drive(const std::string& argument);
/// Opens all of them, in order. Fails with the first error.
core::Result<std::vector<SensorDrive>> open_sensor_drives(const std::vector<std::string>& arguments);

/// The beginning of a drive, in separate files.
struct DrivePart {
  daemon::ReplayFiles files;
  std::uint64_t packets = 0;
  core::Time first_stamp;
  core::Duration length;
};

/// Writes the first `length` of the drive to lidar.pcap and, if there is a CAN log, to imu.candump.log in
/// `folder`, which has to exist. The configuration file is not copied.
core::Result<DrivePart> write_beginning(const SensorDrive& drive, core::Duration length,
                                        const std::filesystem::path& folder);

}  // namespace nilio::tools::bench
