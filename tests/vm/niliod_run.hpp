#pragma once

#include "tests/support/room_drive.hpp"
#include "tests/vm/vm_support.hpp"

#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

namespace nilio::tests {

/// A folder with a drive of a VLP-16 and an IMU, a niliod that receives it live, and niliod's output.
class NiliodRun {
 public:
  /// Writes a drive that ends at its start, so that playing it repeatedly has no jumps. At least 1 s.
  void write_drive(double seconds);
  /// Starts niliod with an output folder, settings for a slow computer, and the given ones
  /// ("imu.interface=can0").
  [[nodiscard]] std::unique_ptr<Program> start_niliod(const std::vector<std::string>& settings) const;
  /// Plays the drive until it is stopped: LiDAR packets over loopback, IMU frames on the bus.
  [[nodiscard]] std::unique_ptr<Program> start_playing(const std::string& can_interface) const;
  /// latency.json, after niliod has ended.
  [[nodiscard]] nlohmann::json summary() const;
  /// Mean frame rate of the drive's IMU.
  [[nodiscard]] double can_frames_per_second() const { return can_frames_per_second_; }

 private:
  TemporaryFolder folder_;
  double can_frames_per_second_ = 0.0;
};

/// True once poses continued for some more status lines.
bool poses_go_on(const Program& niliod);
/// True once the condition holds for a niliod that receives the drive. Otherwise the test fails, unless the
/// kernel's frame count or niliod's log shows that the guest was too slow for the sensors: then `what` is
/// undecided.
bool holds_at_full_pace(const std::function<bool()>& condition, const NiliodRun& run,
                        const std::string& can_interface, const std::string& what,
                        const std::function<std::string()>& log);
/// True once niliod has used the IMU for some status lines; as above.
bool imu_is_used(const Program& niliod, const NiliodRun& run, const std::string& can_interface,
                 const std::string& what);
/// Fails unless niliod tracks; as above.
void check_tracking(const Program& niliod, const NiliodRun& run, const std::string& can_interface);

}  // namespace nilio::tests
