#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace nilio::tools::init {

/// Options of "nilio init".
struct Options {
  /// Captures, CAN logs, and folders of them; empty = live traffic.
  std::vector<std::string> paths;
  std::string output = "vehicle.yaml";
  bool overwrite = false;
  /// Length of the live traffic, or of the evaluated beginning of a recording.
  double seconds = 60.0;
  std::uint16_t port = 2368;
  std::uint16_t position_port = 8308;
  /// Live: CAN interface of the IMU; empty = all that are up.
  std::string can_interface;
  /// "ADDRESS" or "ADDRESS:PORT" of the sensor to write for; empty = the one with most packets.
  std::string sensor;
};

/// Writes a configuration for the vehicle from live traffic or a recording. Returns the exit status, with a
/// message on standard error where it failed.
int run(const Options& options);

}  // namespace nilio::tools::init
