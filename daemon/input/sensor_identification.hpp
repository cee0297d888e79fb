#pragma once

#include "nilio/core/result.hpp"
#include "nilio/drivers/packet.hpp"
#include "nilio/drivers/velodyne/detect.hpp"
#include "nilio/drivers/velodyne/hdl64e/status.hpp"
#include "nilio/drivers/velodyne/model.hpp"

#include "daemon/config/config.hpp"

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace nilio::daemon {

/// Finds out from a LiDAR's first packets which sensor they come from and what its calibration is: the file
/// that the configuration names, or what an HDL-64E sends of itself, or the built-in one. Serves recordings,
/// which are looked at before they are played, and live sensors. One thread; allocates.
class SensorFinder {
 public:
  enum class State {
    kLooking,
    kFound,    ///< take(); there is nothing more to add
    kRefused,  ///< problem(); the next packet begins a new look
  };

  /// `section` of the configuration ("lidar", "lidar2"), for messages.
  SensorFinder(const LidarConfig& config, std::string section);

  State add(const drivers::Packet& packet);
  /// No more packets will come: decides by what there was, never kLooking.
  State finish();

  /// After kFound.
  [[nodiscard]] drivers::VelodyneSensor take() { return std::move(*sensor_); }
  /// What was found, and what to be warned of; one line each.
  [[nodiscard]] const std::vector<std::string>& notes() const { return notes_; }
  [[nodiscard]] const std::vector<std::string>& warnings() const { return warnings_; }
  /// After kRefused: what the packets are, what the configuration says, and what to do.
  [[nodiscard]] const std::string& problem() const { return problem_; }

 private:
  State decide_model();
  State look_at_status(const drivers::Packet& packet);
  State use_stream(const drivers::Hdl64eCalibration& calibration);
  State use_built_in(const std::string& reason);
  State refuse(const std::string& problem);
  [[nodiscard]] std::string model_text() const;

  LidarConfig config_;
  std::string section_;
  std::vector<drivers::Packet> sample_;
  std::optional<drivers::VelodyneSensor> sensor_;
  drivers::Hdl64eStatusReader stream_;
  std::size_t stream_packets_ = 0;
  std::size_t packets_since_gap_ = 0;
  std::uint64_t gaps_ = 0;
  bool carries_table_ = false;
  std::vector<std::string> notes_;
  std::vector<std::string> warnings_;
  std::string problem_;
};

/// The sensor that the configuration alone names, to find what is wrong with it before any packet comes: a
/// model that does not exist, a calibration file that cannot be used.
core::Result<std::monostate> check_lidar(const LidarConfig& config, const std::string& section);

}  // namespace nilio::daemon
