#pragma once

#include "../unit/room_drive.hpp"
#include "vm_support.hpp"

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

namespace nilio::tests {

/// A folder with a drive of a VLP-16 and an IMU, niliod that hears it live, and what niliod leaves.
class NiliodRun {
 public:
  /// Writes a drive that ends where it begins, so that playing it again and again has no jumps. At least 1 s.
  void write_drive(double seconds) const;
  /// With an output folder and the settings ("imu.interface=can0") beside those for a slow computer.
  [[nodiscard]] std::unique_ptr<Program> start_niliod(const std::vector<std::string>& settings) const;
  /// Plays the drive until it is stopped, LiDAR packets over loopback, the IMU's frames on the bus.
  [[nodiscard]] std::unique_ptr<Program> start_playing(const std::string& can_interface) const;
  /// latency.json, once niliod has ended.
  [[nodiscard]] nlohmann::json summary() const;

 private:
  TemporaryFolder folder_;
};

/// Poses have gone on for some status lines more.
bool poses_go_on(const Program& niliod);
/// niliod has used the IMU for some status lines. In a starved guest frames come in bursts,
/// and it may take several tries until the gyroscope is believed.
bool imu_is_used(const Program& niliod);

}  // namespace nilio::tests
