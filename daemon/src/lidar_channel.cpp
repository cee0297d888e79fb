#include "nilio/daemon/lidar_channel.hpp"

#include <algorithm>
#include <cstdio>
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

std::string describe_status(const drivers::ScanAssembler& assembler) {
  const drivers::ScanAssemblerStatus status = assembler.status();
  char text[256];
  std::snprintf(text, sizeof text,
                "%s: return mode %s, %.1f rpm, a packet every %.1f us, field of view %.0f deg, time %s, "
                "offset %.6f s, drift %.1f ppm",
                assembler.sensor().name.c_str(), std::string(drivers::return_mode_name(status.mode)).c_str(),
                status.revolutions_per_minute, status.packet_period_us, 360.0 - status.blind_sector_deg,
                core::name_of(status.clock_source), status.clock_offset_s, status.clock_drift_ppm);
  return text;
}

LidarChannel::LidarChannel(std::string section, const LidarConfig& config,
                           const drivers::ScanAssemblerConfig& assembler_config,
                           std::optional<drivers::VelodyneSensor> sensor, ipc::Ring<Packet>& ring,
                           const ReceiveState& receive_state, FeedLog& log)
    : section_(std::move(section)),
      config_(config),
      assembler_config_(assembler_config),
      ring_(ring),
      receive_state_(receive_state),
      log_(log) {
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
  if (next_ < backlog_.size()) return &backlog_[next_];
  if (!backlog_.empty()) {
    backlog_ = {};
    next_ = 0;
  }
  return nullptr;
}

const Packet* LidarChannel::front() {
  if (assembler_) {
    if (const Packet* packet = next_kept_back()) return packet;
  }
  for (std::span<const Packet> slots = ring_.begin_read(); !slots.empty(); slots = ring_.begin_read()) {
    if (assembler_) return slots.data();
    look(slots.front());
    ring_.consume(1);
    ++packets_taken_;
    if (assembler_) {
      if (const Packet* packet = next_kept_back()) return packet;
    }
  }
  return nullptr;
}

bool LidarChannel::decode_front() {
  const bool is_kept_back = next_ < backlog_.size();
  const Packet& packet = is_kept_back ? backlog_[next_] : ring_.begin_read().front();
  watch_sender(packet);
  last_stamp_ = packet.stamp;
  const bool complete = assembler_->add(packet);
  if (is_kept_back) {
    ++next_;
  } else {
    ring_.consume(1);
    ++packets_taken_;
  }
  return complete;
}

void LidarChannel::take_scan(core::Scan& scan) {
  assembler_->take_scan(scan);
  if (++scans_taken_ == kScansToStatus) report_status();
}

void LidarChannel::report_status() {
  if (!assembler_ || std::exchange(status_reported_, true)) return;
  say(LogLevel::kInfo, describe_status(*assembler_));
}

/// Shows the finder a packet and keeps it for later. What comes before the first data packet is of no use.
void LidarChannel::look(const Packet& packet) {
  const bool is_kept = is_data(packet) || (!backlog_.empty() && backlog_.size() < kLargestBacklog);
  if (!is_kept) {
    count(packet, refused_);
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

bool LidarChannel::settle() {
  if (!finder_ || backlog_.empty()) return false;
  judge(finder_->finish());
  return is_known();
}

void LidarChannel::discard_backlog() {
  for (const Packet& packet : backlog_) count(packet, refused_);
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
  for (const Packet& packet : std::span(backlog_).subspan(next_)) count(packet, stats);
  return stats;
}

}  // namespace nilio::daemon
