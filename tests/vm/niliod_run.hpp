#pragma once

#include "tests/support/room_drive.hpp"
#include "tests/vm/vm_support.hpp"

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
  void write_drive(double seconds);
  /// With an output folder and the settings ("imu.interface=can0") beside those for a slow computer.
  [[nodiscard]] std::unique_ptr<Program> start_niliod(const std::vector<std::string>& settings) const;
  /// Plays the drive until it is stopped, LiDAR packets over loopback, the IMU's frames on the bus.
  [[nodiscard]] std::unique_ptr<Program> start_playing(const std::string& can_interface) const;
  /// latency.json, once niliod has ended.
  [[nodiscard]] nlohmann::json summary() const;
  /// Of the drive's IMU, on average.
  [[nodiscard]] double can_frames_per_second() const { return can_frames_per_second_; }

 private:
  TemporaryFolder folder_;
  double can_frames_per_second_ = 0.0;
};

/// Poses have gone on for some status lines more.
bool poses_go_on(const Program& niliod);
/// True once niliod has used the IMU for some status lines. When that does not come, the test
/// fails, unless the kernel's count of frames says that the guest was too slow for the sensors again and
/// again: then `what` is undecided.
bool imu_is_used(const Program& niliod, const NiliodRun& run, const std::string& can_interface,
                 const std::string& what);

}  // namespace nilio::tests
