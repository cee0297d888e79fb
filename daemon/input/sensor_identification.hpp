#pragma once

#include "nilio/core/result.hpp"
#include "nilio/drivers/packet.hpp"
#include "nilio/drivers/velodyne/detect.hpp"
#include "nilio/drivers/velodyne/hdl64e/status.hpp"
#include "nilio/drivers/velodyne/model.hpp"

#include "daemon/config/config.hpp"
#include "daemon/input/status_stream_order.hpp"

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace nilio::daemon {

/// Data packets needed to identify a sensor.
inline constexpr std::size_t kDetectionPackets = 64;

/// Identifies the sensor from a LiDAR's first packets and selects its calibration: the configured file, the
/// one transmitted by an HDL-64E, or the built-in one. A configured model is used whatever the packets show.
/// Used for recordings before playback and for live sensors. One thread; allocates.
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
  State read_stream();
  State read_status(const StatusByte& byte, bool after_loss);
  State use_stream(const drivers::Hdl64eCalibration& calibration);
  State use_built_in(const std::string& reason);
  State reject(const std::string& problem);
  [[nodiscard]] std::string model_text() const;

  LidarConfig config_;
  std::string section_;
  std::vector<drivers::Packet> sample_;
  drivers::VelodyneDetection detection_;
  std::optional<drivers::VelodyneSensor> sensor_;
  std::optional<StatusStreamOrder> order_;
  drivers::Hdl64eStatusReader stream_;
  /// Packets received, copies included, and different ones.
  std::size_t packets_received_ = 0;
  std::size_t stream_packets_ = 0;
  std::size_t stream_losses_ = 0;
  bool carries_table_ = false;
  std::vector<std::string> notes_;
  std::vector<std::string> warnings_;
  std::string problem_;
};

/// The configured sensor if it needs nothing from the packets: its model is configured, and an HDL-64E's
/// calibration, too.
std::optional<drivers::VelodyneSensor> configured_sensor(const LidarConfig& config);

/// Validates the configured model, return mode and calibration file before any packet arrives.
core::Result<std::monostate> check_lidar(const LidarConfig& config, const std::string& section);

}  // namespace nilio::daemon
