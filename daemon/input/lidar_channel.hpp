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

/// One LiDAR's way from its ring of packets into its scan assembler. While the sensor is not known, another
/// thread searches for it, which keeps packets back; once it is known, they come first, so that none is lost.
/// Packets that do not fit the configuration are refused and counted, which is said once for each reason.
/// What is not said to be the searching thread's belongs to the odometry thread, which does not allocate
/// here.
class LidarChannel {
 public:
  /// `section` names the sensor ("lidar", "lidar2"). `sensor` is nothing when the packets have to tell it.
  /// The references have to outlive the channel.
  LidarChannel(std::string section, const LidarConfig& config,
               const drivers::ScanAssemblerConfig& assembler_config,
               std::optional<drivers::VelodyneSensor> sensor, ipc::Ring<drivers::Packet>& ring,
               const ReceiveState& receive_state, FeedLog& log);

  /// Packet to decode next; null when none is there or the sensor is not known yet.
  const drivers::Packet* front();
  /// Decodes front(), which must not be null. True when a scan became complete.
  bool decode_front();
  /// Ends the scan under assembly; true when there was one that covers enough.
  bool finish_scan() { return assembler_ && assembler_->finish(); }
  /// The scan that became complete.
  void take_scan(core::Scan& scan);

  /// Nothing more will come into the ring. To be asked before front(): what was committed before the end was
  /// announced is then seen.
  [[nodiscard]] bool ended() const {
    return receive_state_.ended.load(std::memory_order_acquire) && !is_searching();
  }

  /// By the searching thread, again and again while wants_search(): looks at the packets in the ring, whose
  /// consumer it is until the sensor is known. At the end of the input what there was has to do. Later it
  /// gives back the memory of the packets that were kept back.
  void search();
  [[nodiscard]] bool wants_search() const {
    return is_searching() || !is_released_.load(std::memory_order_relaxed);
  }
  /// The sensor may still become known. From any thread.
  [[nodiscard]] bool is_searching() const {
    return phase_.load(std::memory_order_acquire) == Phase::kSearching;
  }

  [[nodiscard]] const std::string& section() const { return section_; }
  [[nodiscard]] bool is_known() const { return phase_.load(std::memory_order_acquire) == Phase::kKnown; }
  /// Of the packet decoded last.
  [[nodiscard]] core::Time last_stamp() const { return last_stamp_; }
  /// Taken off the ring so far, whether they were of use or not.
  [[nodiscard]] std::uint64_t packets_taken() const { return packets_taken_.load(std::memory_order_relaxed); }
  /// Of the stream, those that are decoded and those that were of no use to find the sensor: the same number
  /// for the same packets, however long the sensor was searched for. By the odometry thread, of a sensor that
  /// is known.
  [[nodiscard]] std::uint64_t packets_passed() const { return packets_skipped_ + packets_decoded_; }
  /// Received since, and not taken yet.
  [[nodiscard]] std::size_t packets_in_ring() const { return ring_.size(); }
  /// The packet decoded last was kept back while the sensor was not known, or came while such were decoded:
  /// what waits behind it is no backlog that came of slowness.
  [[nodiscard]] bool is_catching_up() const { return is_catching_up_; }
  /// Not decoded yet, those kept back included.
  [[nodiscard]] std::size_t packets_waiting() const {
    return (is_known() && !has_caught_up() ? backlog_.size() - next_ : 0) + ring_.size();
  }

  /// Packets that were refused are counted, too. Only while neither thread runs, as the two below.
  [[nodiscard]] drivers::ScanAssemblerStats stats() const;
  /// Null while the sensor is not known.
  [[nodiscard]] const drivers::ScanAssembler* assembler() const {
    return assembler_ ? &*assembler_ : nullptr;
  }
  /// Says what the stream is like, unless that was done.
  void report_status();

  /// Data packets of several senders came although no sender is configured. From any thread.
  [[nodiscard]] bool has_mixed_senders() const { return mixed_senders_.load(std::memory_order_relaxed); }

 private:
  /// Whose the finder, the backlog and the ring's reading side are: the searching thread's, or the
  /// odometry's.
  enum class Phase : std::uint8_t { kSearching, kKnown, kNeverKnown };

  /// The packets that were kept back are decoded: nobody looks at them any more.
  [[nodiscard]] bool has_caught_up() const { return caught_up_.load(std::memory_order_acquire); }
  const drivers::Packet* next_kept_back();
  bool add_late(const drivers::Packet& packet);
  void look(const drivers::Packet& packet);
  void judge(SensorFinder::State state);
  void discard_backlog();
  void watch_sender(const drivers::Packet& packet);
  void say(LogLevel level, const std::string& text);

  std::string section_;
  LidarConfig config_;
  drivers::ScanAssemblerConfig assembler_config_;
  ipc::Ring<drivers::Packet>& ring_;
  const ReceiveState& receive_state_;
  FeedLog& log_;

  std::atomic<Phase> phase_;
  std::optional<drivers::ScanAssembler> assembler_;
  std::optional<SensorFinder> finder_;
  /// Packets kept back, of which those before `next_` are decoded.
  std::vector<drivers::Packet> backlog_;
  std::size_t next_ = 0;
  std::atomic<bool> caught_up_{false};
  std::int64_t caught_up_ns_ = 0;
  bool is_catching_up_ = false;
  drivers::Packet late_;
  std::atomic<bool> is_released_;
  /// Counts of packets that were refused.
  drivers::ScanAssemblerStats refused_;
  std::vector<std::string> problems_said_;
  core::Time last_stamp_;
  std::atomic<std::uint64_t> packets_taken_{0};
  /// By the searching thread.
  std::uint64_t packets_skipped_ = 0;
  std::uint64_t packets_decoded_ = 0;
  std::uint64_t scans_taken_ = 0;
  std::uint32_t sender_ = 0;
  bool status_reported_ = false;
  std::atomic<bool> mixed_senders_{false};
};

}  // namespace nilio::daemon
