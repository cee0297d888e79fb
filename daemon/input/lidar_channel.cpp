#include "daemon/input/lidar_channel.hpp"

#include <algorithm>
#include <span>
#include <utility>

namespace nilio::daemon {

namespace {

using drivers::Packet;

// An HDL-64E's calibration takes two passes of its status stream; as many other packets may lie between.
constexpr std::size_t kLargestBacklog = 4 * drivers::kHdl64eStatusPackets;
// The evidence in a problem may change from packet to packet: more than so many are not said.
constexpr std::size_t kProblemsSaid = 8;
// Speed, clock and blind sector are known by then.
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
                           const ReceiveState& receive_state, FeedLog& log)
    : section_(std::move(section)),
      config_(config),
      assembler_config_(assembler_config),
      ring_(ring),
      receive_state_(receive_state),
      log_(log),
      phase_(sensor ? Phase::kKnown : Phase::kSearching),
      is_released_(sensor.has_value()) {
  if (sensor) {
    assembler_.emplace(std::move(*sensor), assembler_config_);
  } else {
    finder_.emplace(config_, section_);
  }
}

void LidarChannel::say(LogLevel level, const std::string& text) {
  log_.say(level, section_ == "lidar" ? text : section_ + ": " + text);
}

const Packet* LidarChannel::next_kept_back() {
  if (has_caught_up()) return nullptr;
  if (next_ < backlog_.size()) return &backlog_[next_];
  caught_up_ns_ = monotonic_ns();
  caught_up_.store(true, std::memory_order_release);
  return nullptr;
}

const Packet* LidarChannel::front() {
  if (!is_known()) return nullptr;
  if (const Packet* packet = next_kept_back()) return packet;
  const std::span<const Packet> slots = ring_.begin_read();
  return slots.empty() ? nullptr : slots.data();
}

void LidarChannel::search() {
  if (!is_searching()) {
    if (is_known() && !has_caught_up()) return;
    if (is_known()) backlog_ = {};
    is_released_.store(true, std::memory_order_relaxed);
    return;
  }
  const bool at_end = receive_state_.ended.load(std::memory_order_acquire);
  for (std::span<const Packet> slots = ring_.begin_read(); !assembler_ && !slots.empty();
       slots = ring_.begin_read()) {
    look(slots.front());
    ring_.consume(1);
    packets_taken_.fetch_add(1, std::memory_order_relaxed);
  }
  if (!assembler_ && at_end && !backlog_.empty()) judge(finder_->finish());
  // From here on finder, backlog and ring are the odometry thread's.
  if (assembler_) {
    phase_.store(Phase::kKnown, std::memory_order_release);
  } else if (at_end) {
    phase_.store(Phase::kNeverKnown, std::memory_order_release);
  }
}

bool LidarChannel::decode_front() {
  const bool is_kept_back = !has_caught_up() && next_ < backlog_.size();
  const Packet& packet = is_kept_back ? backlog_[next_] : ring_.begin_read().front();
  watch_sender(packet);
  last_stamp_ = packet.stamp;
  // 0 where nobody knows.
  is_catching_up_ = is_kept_back || (packet.received_ns > 0 && packet.received_ns < caught_up_ns_);
  const bool complete = is_catching_up_ ? add_late(packet) : assembler_->add(packet);
  ++packets_decoded_;
  if (is_kept_back) {
    ++next_;
  } else {
    ring_.consume(1);
    packets_taken_.fetch_add(1, std::memory_order_relaxed);
  }
  return complete;
}

/// Nobody could have used it before: its deadline runs from now.
bool LidarChannel::add_late(const Packet& packet) {
  late_ = packet;
  late_.received_ns = monotonic_ns();
  return assembler_->add(late_);
}

void LidarChannel::take_scan(core::Scan& scan) {
  assembler_->take_scan(scan);
  if (++scans_taken_ == kScansToStatus) report_status();
}

void LidarChannel::report_status() {
  if (!assembler_ || std::exchange(status_reported_, true)) return;
  FeedEvent event;
  event.kind = FeedEvent::Kind::kStreamStatus;
  copy_name(section_, event.section);
  copy_name(assembler_->sensor().name, event.model);
  event.status = assembler_->status();
  log_.report(event);
}

/// Shows the finder a packet and keeps it for later. What comes before the first data packet is of no use.
void LidarChannel::look(const Packet& packet) {
  const bool is_kept = is_data(packet) || (!backlog_.empty() && backlog_.size() < kLargestBacklog);
  if (!is_kept) {
    count(packet, refused_);
    ++packets_skipped_;
    return;
  }
  backlog_.push_back(packet);
  judge(finder_->add(packet));
}

void LidarChannel::judge(SensorFinder::State state) {
  if (state == SensorFinder::State::kFound) {
    for (const std::string& note : finder_->notes()) say(LogLevel::kInfo, note);
    for (const std::string& warning : finder_->warnings()) log_.say(LogLevel::kWarning, warning);
    assembler_.emplace(finder_->take(), assembler_config_);
    finder_.reset();
  } else if (state == SensorFinder::State::kRefused) {
    const std::string& problem = finder_->problem();
    const bool is_new =
        std::find(problems_said_.begin(), problems_said_.end(), problem) == problems_said_.end();
    if (is_new && problems_said_.size() < kProblemsSaid) {
      problems_said_.push_back(problem);
      say(LogLevel::kError, problem + "; no poses until then");
    }
    discard_backlog();
  }
}

void LidarChannel::discard_backlog() {
  for (const Packet& packet : backlog_) count(packet, refused_);
  packets_skipped_ += backlog_.size();
  backlog_.clear();
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
    for (const Packet& packet : std::span(backlog_).subspan(next_)) count(packet, stats);
  }
  return stats;
}

}  // namespace nilio::daemon
