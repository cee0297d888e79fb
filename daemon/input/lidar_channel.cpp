#include "daemon/input/lidar_channel.hpp"

#include <algorithm>
#include <span>
#include <utility>

namespace nilio::daemon {

namespace {

using drivers::Packet;

// An HDL-64E's calibration takes two passes of its status stream; allow as many other packets in between.
constexpr std::size_t kMaxBuffered = 4 * drivers::kHdl64eStatusPackets;
// The evidence in a message may differ from packet to packet, so the number of messages is limited.
constexpr std::size_t kMaxProblemsLogged = 8;
// Rotation rate, clock and blind sector are estimated by then.
constexpr std::uint64_t kScansToStatus = 10;

bool is_data(const Packet& packet) { return packet.size == drivers::kDataPacketSize && !packet.truncated; }

void count(const Packet& packet, drivers::ScanAssemblerStats& stats) {
  if (is_data(packet)) {
    ++stats.packets;
  } else if (packet.size == drivers::kPositionPacketSize && !packet.truncated) {
    ++stats.position_packets;
  } else {
    ++stats.bad_length;
  }
}

}  // namespace

LidarChannel::LidarChannel(std::string section, const LidarConfig& config,
                           const drivers::ScanAssemblerConfig& assembler_config,
                           std::optional<drivers::VelodyneSensor> sensor, ipc::Ring<Packet>& ring,
                           const ReceiveState& receive_state, EventLog& log)
    : section_(std::move(section)),
      config_(config),
      assembler_config_(assembler_config),
      ring_(ring),
      receive_state_(receive_state),
      log_(log),
      phase_(sensor ? Phase::kIdentified : Phase::kIdentifying),
      is_released_(sensor.has_value()) {
  if (sensor) {
    assembler_.emplace(std::move(*sensor), assembler_config_);
  } else {
    identification_.emplace(config_, section_);
  }
}

void LidarChannel::log(LogLevel level, const std::string& text) {
  log_.log(level, section_ == "lidar" ? text : section_ + ": " + text);
}

const Packet* LidarChannel::next_buffered() {
  if (has_caught_up()) return nullptr;
  if (next_ < buffered_.size()) return &buffered_[next_];
  caught_up_ns_ = monotonic_ns();
  caught_up_.store(true, std::memory_order_release);
  return nullptr;
}

const Packet* LidarChannel::front() {
  if (!is_identified()) return nullptr;
  if (const Packet* packet = next_buffered()) return packet;
  const std::span<const Packet> slots = ring_.begin_read();
  return slots.empty() ? nullptr : slots.data();
}

void LidarChannel::identify() {
  if (!is_identifying()) {
    if (is_identified() && !has_caught_up()) return;
    if (is_identified()) buffered_ = {};
    is_released_.store(true, std::memory_order_relaxed);
    return;
  }
  const bool at_end = receive_state_.ended.load(std::memory_order_acquire);
  for (std::span<const Packet> slots = ring_.begin_read(); !assembler_ && !slots.empty();
       slots = ring_.begin_read()) {
    examine(slots.front());
    ring_.consume(1);
    packets_taken_.fetch_add(1, std::memory_order_relaxed);
  }
  if (!assembler_ && at_end && !buffered_.empty()) handle(identification_->finish());
  // Identification, buffered packets and ring belong to the odometry thread from here on.
  if (assembler_) {
    phase_.store(Phase::kIdentified, std::memory_order_release);
  } else if (at_end) {
    phase_.store(Phase::kUnidentified, std::memory_order_release);
  }
}

bool LidarChannel::decode_front() {
  const bool is_buffered = !has_caught_up() && next_ < buffered_.size();
  const Packet& packet = is_buffered ? buffered_[next_] : ring_.begin_read().front();
  watch_sender(packet);
  last_stamp_ = packet.stamp;
  // A receive time of 0 means unknown.
  is_catching_up_ = is_buffered || (packet.received_ns > 0 && packet.received_ns < caught_up_ns_);
  const bool complete = is_catching_up_ ? add_delayed(packet) : assembler_->add(packet);
  ++packets_decoded_;
  if (is_buffered) {
    ++next_;
  } else {
    ring_.consume(1);
    packets_taken_.fetch_add(1, std::memory_order_relaxed);
  }
  return complete;
}

/// Decodes a delayed packet with the current time as receive time: its deadline starts now.
bool LidarChannel::add_delayed(const Packet& packet) {
  delayed_ = packet;
  delayed_.received_ns = monotonic_ns();
  return assembler_->add(delayed_);
}

void LidarChannel::take_scan(core::Scan& scan) {
  assembler_->take_scan(scan);
  if (++scans_taken_ == kScansToStatus) report_status();
}

void LidarChannel::report_status() {
  if (!assembler_ || std::exchange(status_reported_, true)) return;
  LidarEvent event;
  event.kind = LidarEvent::Kind::kStreamStatus;
  copy_name(section_, event.section);
  copy_name(assembler_->sensor().name, event.model);
  event.status = assembler_->status();
  log_.report(event);
}

/// Passes a packet to the identification and buffers it. Packets before the first data packet are discarded.
void LidarChannel::examine(const Packet& packet) {
  const bool is_kept = is_data(packet) || (!buffered_.empty() && buffered_.size() < kMaxBuffered);
  if (!is_kept) {
    count(packet, refused_);
    ++packets_skipped_;
    return;
  }
  buffered_.push_back(packet);
  handle(identification_->add(packet));
}

void LidarChannel::handle(SensorIdentification::State state) {
  if (state == SensorIdentification::State::kIdentified) {
    for (const std::string& note : identification_->notes()) log(LogLevel::kInfo, note);
    for (const std::string& warning : identification_->warnings()) log_.log(LogLevel::kWarning, warning);
    assembler_.emplace(identification_->take(), assembler_config_);
    identification_.reset();
  } else if (state == SensorIdentification::State::kRejected) {
    const std::string& problem = identification_->problem();
    const bool is_new =
        std::find(problems_logged_.begin(), problems_logged_.end(), problem) == problems_logged_.end();
    if (is_new && problems_logged_.size() < kMaxProblemsLogged) {
      problems_logged_.push_back(problem);
      log(LogLevel::kError, problem + "; no poses until this is resolved");
    }
    discard_buffered();
  }
}

void LidarChannel::discard_buffered() {
  for (const Packet& packet : buffered_) count(packet, refused_);
  packets_skipped_ += buffered_.size();
  buffered_.clear();
}

void LidarChannel::watch_sender(const Packet& packet) {
  if (!config_.sender_address.empty() || !is_data(packet)) return;
  if (sender_ == 0) sender_ = packet.sender_address;
  if (packet.sender_address != sender_) mixed_senders_.store(true, std::memory_order_relaxed);
}

drivers::ScanAssemblerStats LidarChannel::stats() const {
  drivers::ScanAssemblerStats stats = assembler_ ? assembler_->stats() : drivers::ScanAssemblerStats{};
  stats.packets += refused_.packets;
  stats.position_packets += refused_.position_packets;
  stats.bad_length += refused_.bad_length;
  if (!has_caught_up()) {
    for (const Packet& packet : std::span(buffered_).subspan(next_)) count(packet, stats);
  }
  return stats;
}

}  // namespace nilio::daemon
