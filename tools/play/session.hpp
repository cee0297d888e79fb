#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/time.hpp"
#include "nilio/drivers/can/socketcan/socketcan.hpp"
#include "nilio/drivers/packet.hpp"
#include "nilio/drivers/source.hpp"

#include "ipc/histogram.hpp"
#include "tools/play/sender.hpp"
#include "tools/play/timeline.hpp"

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace nilio::tools::play {

struct PlayConfig {
  /// In order; several files are parts of one recording.
  std::vector<std::string> captures;
  std::vector<std::string> can_logs;
  /// Ports of the packets to take from the captures.
  std::uint16_t recorded_port = 2368;
  std::uint16_t recorded_position_port = 8308;
  /// Ports to send to; 0 = as recorded.
  std::uint16_t port = 0;
  std::uint16_t position_port = 0;
  PacketSenderConfig sender;
  /// Interface to send the frames of the CAN logs on; empty = they are not played.
  std::string can_interface;
  double speed = 1.0;
  /// Not paced at all.
  bool fast = false;
  core::Duration longest_gap{10'000'000'000};
  /// Number of repetitions; 0 = until stopped.
  std::uint64_t loops = 1;
  bool restamp = false;
};

struct PlayReport {
  std::uint64_t packets = 0;
  std::uint64_t frames = 0;
  std::uint64_t packets_failed = 0;
  std::uint64_t frames_failed = 0;
  /// Not sendable as recorded: longer than a packet slot, or error frames.
  std::uint64_t skipped = 0;
  std::uint64_t loops = 0;
  /// Delay from due time to the system call.
  std::int64_t late_p50_ns = 0;
  std::int64_t late_p99_ns = 0;
  std::int64_t late_max_ns = 0;
};

/// Sends a recording at its own pace: sleeps until absolute times, and sends together the packets that are
/// due. One thread.
class PlaySession {
 public:
  using Report = std::function<void(const std::string&)>;

  /// Opens the files and the sockets. `report` receives a line for people about gaps, jumps and errors.
  static core::Result<std::unique_ptr<PlaySession>> open(const PlayConfig& config, Report report);

  /// Returns at the end, or soon after `stop_wanted` (polled every 20 ms) returns true.
  PlayReport run(const std::function<bool()>& stop_wanted);

 private:
  /// A source with a buffer of slots.
  template <class Slot>
  struct Lookahead {
    std::unique_ptr<drivers::Source<Slot>> source;
    std::vector<Slot> slots;
    std::size_t next = 0;
    std::size_t count = 0;
    /// Null at the end.
    const Slot* front();
  };

  PlaySession(PlayConfig config, Report report);

  core::Result<std::size_t> open_sources();
  void warn_of_distant_starts();
  bool play_once();
  bool wait_until_due(const PlayTimeline::Due& due);
  void add_packet(const drivers::Packet& packet, const PlayTimeline::Due& due);
  void send_batch();
  void send_frame(const drivers::CanFrame& frame, const PlayTimeline::Due& due);
  void note_event(const PlayTimeline::Due& due, core::Time stamp);
  void note_late(std::int64_t due_ns, std::int64_t now_ns);
  bool is_stopped(std::int64_t now_ns);

  const PlayConfig config_;
  const Report report_;
  Lookahead<drivers::Packet> packets_;
  Lookahead<drivers::CanFrame> frames_;
  std::optional<PacketSender> packet_sender_;
  std::optional<drivers::CanSender> can_sender_;
  PlayTimeline timeline_;
  Restamper restamper_;
  std::vector<drivers::Packet> batch_;
  std::vector<std::int64_t> batch_due_ns_;
  core::Time first_stamp_;
  PlayReport result_;
  ipc::Histogram lateness_;
  std::int64_t late_max_ns_ = 0;
  const std::function<bool()>* stop_wanted_ = nullptr;
  std::int64_t next_stop_check_ns_ = 0;
  bool stopped_ = false;
};

}  // namespace nilio::tools::play
