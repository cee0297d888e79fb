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

/// Identifies the sensor from a LiDAR's first packets and selects its calibration: the configured file, the
/// one transmitted by an HDL-64E, or the built-in one. Used for recordings before playback and for live
/// sensors. One thread; allocates.
class SensorIdentification {
 public:
  enum class State {
    kUndecided,
    kIdentified,  ///< call take(); no more packets are needed
    kRejected,    ///< see problem(); the next packet starts a new attempt
  };

  /// `section` of the configuration ("lidar", "lidar2"), for messages.
  SensorIdentification(const LidarConfig& config, std::string section);

  State add(const drivers::Packet& packet);
  /// End of the input: decides from the available packets, never kUndecided.
  State finish();

  /// After kIdentified.
  [[nodiscard]] drivers::VelodyneSensor take() { return std::move(*sensor_); }
  /// Log lines about the sensor, and warnings.
  [[nodiscard]] const std::vector<std::string>& notes() const { return notes_; }
  [[nodiscard]] const std::vector<std::string>& warnings() const { return warnings_; }
  /// After kRejected: detected sensor, configured sensor, and remedy.
  [[nodiscard]] const std::string& problem() const { return problem_; }

 private:
  State decide_model();
  State read_status(const drivers::Packet& packet);
  State use_stream(const drivers::Hdl64eCalibration& calibration);
  State use_built_in(const std::string& reason);
  State reject(const std::string& problem);
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

/// Validates the configured model and calibration file before any packet arrives.
core::Result<std::monostate> check_lidar(const LidarConfig& config, const std::string& section);

/// The configured sensor, where its packets need not be read for it: empty for `model: auto`, and for
/// an HDL-64E without a calibration file, which may transmit one. Call after check_lidar().
std::optional<drivers::VelodyneSensor> configured_sensor(const LidarConfig& config);

}  // namespace nilio::daemon
