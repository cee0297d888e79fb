#pragma once

#include "nilio/core/result.hpp"
#include "nilio/drivers/capture/record_parts.hpp"
#include "nilio/drivers/packet.hpp"

#include "tools/record/channel.hpp"

#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <thread>
#include <vector>

namespace nilio::tools::record {

struct RecordConfig {
  std::filesystem::path folder;
  std::string bind_address = "0.0.0.0";
  /// Only packets of this sender; empty = any.
  std::string sender_address;
  /// Group to join, and the interface to join on; empty = none.
  std::string multicast_group;
  std::string multicast_interface;
  /// 0 = none.
  std::uint16_t data_port = 2368;
  std::uint16_t position_port = 8308;
  int receive_buffer_bytes = 8 * 1024 * 1024;
  std::vector<std::string> can_interfaces;
  drivers::RecordLimits limits;
  /// Memory for packets waiting for the disk.
  std::size_t ring_bytes = std::size_t{128} * 1024 * 1024;
  /// SCHED_FIFO priority of the receive threads; 0 = normal scheduling.
  int priority = 60;
};

struct RecordProgress {
  std::uint64_t packets = 0;  ///< in files
  std::uint64_t frames = 0;
  std::uint64_t bytes = 0;
  std::uint64_t received = 0;  ///< packets and frames from the sockets
  std::uint64_t kernel_dropped = 0;
  std::uint64_t ring_dropped = 0;
  std::uint64_t disk_lost = 0;  ///< dropped because the disk was full
  std::uint64_t files = 0;
  std::uint64_t deleted = 0;
  std::uint64_t part = 0;
  bool blocked = false;
  bool all_sources_failed = false;
};

/// Sockets -> receive threads -> rings -> writer thread -> files. Data reach the kernel within half a second
/// and the disk within about 1.5 s.
class RecordSession {
 public:
  /// Opens the sockets and the folder; receiving begins with start(). `report` is called from several
  /// threads.
  static core::Result<std::unique_ptr<RecordSession>> open(const RecordConfig& config,
                                                           drivers::RecordParts::Report report);
  RecordSession(const RecordSession&) = delete;
  RecordSession& operator=(const RecordSession&) = delete;
  ~RecordSession();

  void start();
  /// Receives pending packets, writes everything and closes the files. May be repeated.
  void stop();
  [[nodiscard]] RecordProgress progress() const;
  /// A line for each source; `silent_only`: only sources without data and failed ones.
  [[nodiscard]] std::vector<std::string> source_lines(bool silent_only) const;

 private:
  explicit RecordSession(const RecordConfig& config, drivers::RecordParts::Report report)
      : config_(config), report_(std::move(report)) {}

  core::Result<std::size_t> open_sources();
  core::Result<std::size_t> add_udp(std::uint16_t port, std::size_t slots);
  core::Result<std::size_t> add_can(const std::string& interface_name);
  void set_priority(const char* thread_name);
  void write_until_finished();
  void drain(const RingHorizon& horizon);

  const RecordConfig config_;
  const drivers::RecordParts::Report report_;
  drivers::RecordCounters counters_;
  std::unique_ptr<drivers::RecordParts> parts_;
  std::vector<std::unique_ptr<RecordChannel<drivers::Packet>>> lidar_;
  std::vector<std::unique_ptr<RecordChannel<drivers::CanFrame>>> can_;
  std::unique_ptr<RingMerger<drivers::Packet>> lidar_merger_;
  std::unique_ptr<RingMerger<drivers::CanFrame>> can_merger_;
  std::vector<std::uint8_t> record_;
  std::atomic<std::uint64_t> unrecordable_{0};
  std::atomic<bool> stop_receiving_{false};
  std::atomic<bool> stop_writing_{false};
  std::vector<std::thread> receivers_;
  std::thread writer_;
};

}  // namespace nilio::tools::record
