#pragma once

#include "nilio/core/scan.hpp"
#include "nilio/core/time.hpp"
#include "nilio/drivers/imu/hdl32e_imu.hpp"
#include "nilio/drivers/packet.hpp"
#include "nilio/drivers/velodyne/decoder.hpp"

#include "daemon/config/config.hpp"
#include "daemon/input/receive.hpp"
#include "daemon/input/sender_selection.hpp"
#include "daemon/input/sensor_identification.hpp"
#include "daemon/output/event_log.hpp"
#include "ipc/ring.hpp"

#include <atomic>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace nilio::daemon {

/// Per-LiDAR input path from the packet ring to the scan assembler. Decodes the packets of one sender
/// (SenderSelection), identifies the sensor from them unless it is known, and buffers them meanwhile, so that
/// none is lost. Another sender's packets are counted and reported once. A sensor that replaces a silent one
/// is identified anew. Packets that contradict the configuration are logged once per reason.
///
/// Unless stated otherwise, members belong to the odometry thread. They allocate only while a sensor is being
/// identified, before its first scan.
class LidarChannel {
 public:
  /// `section` names the sensor ("lidar", "lidar2"). Pass an empty `sensor` for a live sensor: it is the
  /// configured one, or identified from the packets. All references must outlive the channel.
  LidarChannel(std::string section, const LidarConfig& config,
               const drivers::ScanAssemblerConfig& assembler_config,
               std::optional<drivers::VelodyneSensor> sensor, ipc::Ring<drivers::Packet>& ring,
               const ReceiveState& receive_state, EventLog& log);

  /// Next packet to decode; null if there is none. Evaluates waiting packets until it finds one; at the end
  /// of the input decides from the packets available.
  const drivers::Packet* front();
  /// Decodes front(), which must not be null. Returns true if a scan is complete.
  bool decode_front();
  /// Ends the scan under assembly; true if it covers enough of the field of view.
  bool finish_scan() { return assembler_ && assembler_->finish(); }
  /// Moves the completed scan into `scan`.
  void take_scan(core::Scan& scan);
  /// Writes the samples of an HDL-32E's own IMU into `ring`, which then has this thread as producer. Call
  /// before the first packet. `time_offset` is subtracted from their stamps.
  void use_own_imu(ipc::Ring<core::ImuSample>& ring, core::Duration time_offset);

  /// True after the last packet. Check it before front(), so that packets committed before the end are seen.
  [[nodiscard]] bool ended() const { return receive_state_.ended.load(std::memory_order_acquire); }

  [[nodiscard]] const std::string& section() const { return section_; }
  /// Packets of this sensor are decoded. Any thread.
  [[nodiscard]] bool is_identified() const { return identified_.load(std::memory_order_acquire); }
  /// Stamp of the last decoded packet.
  [[nodiscard]] core::Time last_stamp() const { return last_stamp_; }
  /// Packets read from the ring so far, useful or not. Any thread.
  [[nodiscard]] std::uint64_t packets_taken() const { return packets_taken_.load(std::memory_order_relaxed); }
  /// Packets of the stream that were decoded or skipped. The number depends on the packets only, not on the
  /// duration of the identification. Sensor must be identified.
  [[nodiscard]] std::uint64_t packets_passed() const { return packets_skipped_ + packets_decoded_; }
  /// Data and position packets of other senders; not decoded. Any thread.
  [[nodiscard]] std::uint64_t foreign_packets() const {
    return foreign_packets_.load(std::memory_order_relaxed);
  }
  /// Received packets that wait in the ring.
  [[nodiscard]] std::size_t packets_in_ring() const { return ring_.size(); }
  [[nodiscard]] std::size_t ring_capacity() const { return ring_.capacity(); }
  /// The last decoded packet waited in the socket during the start or was buffered during identification, or
  /// arrived while such packets were decoded. Packets behind it are no sign of overload.
  [[nodiscard]] bool is_catching_up() const { return is_catching_up_; }
  /// Packets not decoded yet, including buffered ones.
  [[nodiscard]] std::size_t packets_waiting() const { return buffered_.size() - next_ + ring_.size(); }

  /// Assembler statistics of the whole run including rejected packets, without packets that the own ring
  /// dropped among the lost ones. Call this and the next two only while the odometry thread does not run.
  [[nodiscard]] drivers::ScanAssemblerStats stats() const;
  /// Null until the sensor is identified.
  [[nodiscard]] const drivers::ScanAssembler* assembler() const {
    return assembler_ ? &*assembler_ : nullptr;
  }
  [[nodiscard]] const drivers::ImuDecoderStats& imu_stats() const { return imu_.stats(); }
  /// Reports the stream status (model, rotation rate, clock) once.
  void report_status();

 private:
  bool admit(const drivers::Packet& packet);
  void consume_front();
  void on_sender();
  void on_other_sensor();
  void begin_identification();
  void discard_foreign();
  void identify_buffered();
  void handle(SensorIdentification::State state);
  void report_resets(const core::Scan& scan);
  void report_identification(const SensorIdentification& identification);
  void end_identification();
  void discard_buffered();
  void release_buffer();
  void note_foreign(const drivers::Packet& packet);
  void pass_on_imu_samples(const drivers::Packet& packet);
  bool add_delayed(const drivers::Packet& packet);
  void set_identified(bool identified) { identified_.store(identified, std::memory_order_release); }
  void log(LogLevel level, const std::string& text);

  std::string section_;
  LidarConfig config_;
  drivers::ScanAssemblerConfig assembler_config_;
  ipc::Ring<drivers::Packet>& ring_;
  const ReceiveState& receive_state_;
  EventLog& log_;

  SenderSelection selection_;
  bool has_sender_ = false;
  /// The sensor was passed to the constructor: it stays the same when its address changes.
  bool is_given_;
  /// A sender is selected and its sensor is known.
  std::atomic<bool> identified_{false};
  std::optional<drivers::ScanAssembler> assembler_;
  /// Runs until the model is known; beside the assembler of a configured model, to check it.
  std::optional<SensorIdentification> identification_;
  /// Packets buffered during identification: up to `examined_` evaluated, up to `next_` decoded.
  std::vector<drivers::Packet> buffered_;
  std::size_t examined_ = 0;
  std::size_t next_ = 0;
  /// The ring's first packet is to be decoded.
  bool is_front_admitted_ = false;
  std::int64_t first_received_ns_ = 0;
  std::int64_t caught_up_ns_ = 0;
  bool is_catching_up_ = false;
  drivers::Packet delayed_;
  /// Counters of rejected packets and of sensors that were replaced.
  drivers::ScanAssemblerStats past_;
  bool is_other_sensor_ = false;
  std::vector<std::string> problems_logged_;
  core::Time last_stamp_;
  std::atomic<std::uint64_t> packets_taken_{0};
  std::atomic<std::uint64_t> foreign_packets_{0};
  std::uint64_t packets_skipped_ = 0;
  std::uint64_t packets_decoded_ = 0;
  std::uint64_t scans_taken_ = 0;
  /// Counters at the last scan.
  drivers::ScanAssemblerStats reported_;
  bool status_reported_ = false;
  ipc::Ring<core::ImuSample>* imu_ring_ = nullptr;
  core::Duration imu_time_offset_;
  drivers::Hdl32eImu imu_;
};

}  // namespace nilio::daemon
