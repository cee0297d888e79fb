#pragma once

#include "nilio/core/scan.hpp"
#include "nilio/core/time.hpp"
#include "nilio/drivers/packet.hpp"
#include "nilio/drivers/velodyne/decoder.hpp"

#include "daemon/config/config.hpp"
#include "daemon/input/receive.hpp"
#include "daemon/input/sensor_identification.hpp"
#include "daemon/output/event_log.hpp"
#include "ipc/ring.hpp"

#include <atomic>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace nilio::daemon {

/// Per-LiDAR input path from the packet ring to the scan assembler. Until the sensor is identified, a
/// separate thread reads the ring and buffers the packets; afterwards the buffered packets are decoded first,
/// so none is lost. Packets that contradict the configuration are rejected, counted and logged once per
/// reason. Unless stated otherwise, members belong to the odometry thread and do not allocate.
class LidarChannel {
 public:
  /// `section` names the sensor ("lidar", "lidar2"). Pass an empty `sensor` to identify it from the packets.
  /// All references must outlive the channel.
  LidarChannel(std::string section, const LidarConfig& config,
               const drivers::ScanAssemblerConfig& assembler_config,
               std::optional<drivers::VelodyneSensor> sensor, ipc::Ring<drivers::Packet>& ring,
               const ReceiveState& receive_state, EventLog& log);

  /// Next packet to decode; null if there is none or the sensor is not identified yet.
  const drivers::Packet* front();
  /// Decodes front(), which must not be null. Returns true if a scan is complete.
  bool decode_front();
  /// Ends the scan under assembly; true if it covers enough of the field of view.
  bool finish_scan() { return assembler_ && assembler_->finish(); }
  /// Moves the completed scan into `scan`.
  void take_scan(core::Scan& scan);

  /// True after the last packet. Check it before front(), so that packets committed before the end are seen.
  [[nodiscard]] bool ended() const {
    return receive_state_.ended.load(std::memory_order_acquire) && !is_identifying();
  }

  /// Reads the ring in the identification thread; call repeatedly while wants_identification(). This thread
  /// is the ring's consumer until the sensor is identified. At the end of the input it decides from the
  /// available packets; later it frees the buffered packets.
  void identify();
  [[nodiscard]] bool wants_identification() const {
    return is_identifying() || !is_released_.load(std::memory_order_relaxed);
  }
  /// Identification is still in progress. Any thread.
  [[nodiscard]] bool is_identifying() const {
    return phase_.load(std::memory_order_acquire) == Phase::kIdentifying;
  }

  [[nodiscard]] const std::string& section() const { return section_; }
  [[nodiscard]] bool is_identified() const {
    return phase_.load(std::memory_order_acquire) == Phase::kIdentified;
  }
  /// Stamp of the last decoded packet.
  [[nodiscard]] core::Time last_stamp() const { return last_stamp_; }
  /// Packets read from the ring so far, useful or not.
  [[nodiscard]] std::uint64_t packets_taken() const { return packets_taken_.load(std::memory_order_relaxed); }
  /// Packets of the stream that were decoded or skipped. The number depends on the packets only, not on the
  /// duration of the identification. Odometry thread; sensor must be identified.
  [[nodiscard]] std::uint64_t packets_passed() const { return packets_skipped_ + packets_decoded_; }
  /// Received packets that wait in the ring.
  [[nodiscard]] std::size_t packets_in_ring() const { return ring_.size(); }
  /// The last decoded packet was buffered during identification, or arrived while buffered packets were
  /// decoded. Packets behind it are no sign of overload.
  [[nodiscard]] bool is_catching_up() const { return is_catching_up_; }
  /// Packets not decoded yet, including buffered ones.
  [[nodiscard]] std::size_t packets_waiting() const {
    return (is_identified() && !has_caught_up() ? buffered_.size() - next_ : 0) + ring_.size();
  }

  /// Assembler statistics including rejected packets. Call this and the next two only while neither thread
  /// runs.
  [[nodiscard]] drivers::ScanAssemblerStats stats() const;
  /// Null until the sensor is identified.
  [[nodiscard]] const drivers::ScanAssembler* assembler() const {
    return assembler_ ? &*assembler_ : nullptr;
  }
  /// Reports the stream status (model, rotation rate, clock) once.
  void report_status();

  /// Data packets of several senders arrived although no sender is configured. Any thread.
  [[nodiscard]] bool has_mixed_senders() const { return mixed_senders_.load(std::memory_order_relaxed); }

 private:
  /// Owner of identification, buffered packets and read side of the ring: the identification thread or the
  /// odometry thread.
  enum class Phase : std::uint8_t { kIdentifying, kIdentified, kUnidentified };

  /// All buffered packets are decoded; the buffer is no longer used by the odometry thread.
  [[nodiscard]] bool has_caught_up() const { return caught_up_.load(std::memory_order_acquire); }
  const drivers::Packet* next_buffered();
  bool add_delayed(const drivers::Packet& packet);
  void examine(const drivers::Packet& packet);
  void handle(SensorIdentification::State state);
  void discard_buffered();
  void watch_sender(const drivers::Packet& packet);
  void log(LogLevel level, const std::string& text);

  std::string section_;
  LidarConfig config_;
  drivers::ScanAssemblerConfig assembler_config_;
  ipc::Ring<drivers::Packet>& ring_;
  const ReceiveState& receive_state_;
  EventLog& log_;

  std::atomic<Phase> phase_;
  std::optional<drivers::ScanAssembler> assembler_;
  std::optional<SensorIdentification> identification_;
  /// Packets buffered during identification; those before `next_` are decoded.
  std::vector<drivers::Packet> buffered_;
  std::size_t next_ = 0;
  std::atomic<bool> caught_up_{false};
  std::int64_t caught_up_ns_ = 0;
  bool is_catching_up_ = false;
  drivers::Packet delayed_;
  std::atomic<bool> is_released_;
  /// Counters of rejected packets.
  drivers::ScanAssemblerStats refused_;
  std::vector<std::string> problems_logged_;
  core::Time last_stamp_;
  std::atomic<std::uint64_t> packets_taken_{0};
  /// Written by the identification thread.
  std::uint64_t packets_skipped_ = 0;
  std::uint64_t packets_decoded_ = 0;
  std::uint64_t scans_taken_ = 0;
  std::uint32_t sender_ = 0;
  bool status_reported_ = false;
  std::atomic<bool> mixed_senders_{false};
};

}  // namespace nilio::daemon
