#include "daemon/input/lidar_channel.hpp"

#include "nilio/drivers/velodyne/clock/position_packet.hpp"
#include "nilio/drivers/velodyne/packet.hpp"

#include <algorithm>
#include <array>
#include <span>
#include <utility>

namespace nilio::daemon {

namespace {

using drivers::is_data_packet;
using drivers::is_position_packet;
using drivers::Packet;

// Senders of which none is steady fill no more than this.
constexpr std::size_t kMaxUndecided = 8 * SenderSelection::kSteadyPackets;
// An HDL-64E's calibration takes two passes of its status stream; allow as many other packets in between.
constexpr std::size_t kMaxBuffered = 4 * drivers::kHdl64eStatusPackets;
// The evidence in a message may differ from packet to packet, so the number of messages is limited.
constexpr std::size_t kMaxProblemsLogged = 8;
// The receive thread reads a full socket buffer in less: these packets waited in the socket during the start.
constexpr std::int64_t kStartBacklogNs = 50'000'000;
// Rotation rate, clock and blind sector are estimated by then.
constexpr std::uint64_t kScansToStatus = 10;

void count(const Packet& packet, drivers::ScanAssemblerStats& stats) {
  if (is_data_packet(packet)) {
    ++stats.packets;
  } else if (is_position_packet(packet)) {
    ++stats.position_packets;
  } else {
    ++stats.bad_length;
  }
}

void add_to(drivers::ScanAssemblerStats& sum, const drivers::ScanAssemblerStats& other) {
  using Stats = drivers::ScanAssemblerStats;
  constexpr std::array kCounts{&Stats::packets,
                               &Stats::position_packets,
                               &Stats::bad_length,
                               &Stats::duplicate_packets,
                               &Stats::late_packets,
                               &Stats::lost_packets,
                               &Stats::damaged_stamps,
                               &Stats::time_jumps,
                               &Stats::host_clock_jumps,
                               &Stats::mode_changes,
                               &Stats::firings,
                               &Stats::firings_in_scans,
                               &Stats::firings_discarded,
                               &Stats::firings_bad,
                               &Stats::firings_late,
                               &Stats::scans,
                               &Stats::partial_scans,
                               &Stats::points,
                               &Stats::points_out_of_range};
  static_assert(sizeof(Stats) == kCounts.size() * sizeof(std::uint64_t), "every counter is summed up");
  for (const auto member : kCounts) sum.*member += other.*member;
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
      is_given_(sensor.has_value()) {
  if (sensor) {
    assembler_.emplace(std::move(*sensor), assembler_config_);
  } else {
    begin_identification();
  }
}

/// A configured sensor is decoded from its first packet, and only checked by the identification.
void LidarChannel::begin_identification() {
  identification_.emplace(config_, section_);
  if (std::optional<drivers::VelodyneSensor> sensor = configured_sensor(config_))
    assembler_.emplace(std::move(*sensor), assembler_config_);
}

void LidarChannel::log(LogLevel level, const std::string& text) {
  log_.log(level, section_ == "lidar" ? text : section_ + ": " + text);
}

const Packet* LidarChannel::front() {
  const bool at_end = ended();
  while (true) {
    if (is_identified() && next_ < buffered_.size()) return &buffered_[next_];
    release_buffer();
    const std::span<const Packet> slots = ring_.begin_read();
    if (slots.empty()) break;
    is_front_admitted_ = is_front_admitted_ || admit(slots.front());
    if (is_front_admitted_) return slots.data();
    consume_front();
  }
  if (!at_end || is_identified()) return nullptr;
  end_identification();
  return is_identified() && next_ < buffered_.size() ? &buffered_[next_] : nullptr;
}

void LidarChannel::consume_front() {
  ring_.consume(1);
  is_front_admitted_ = false;
  packets_taken_.fetch_add(1, std::memory_order_relaxed);
}

/// True if the ring's first packet is to be decoded now; otherwise it was buffered or counted.
bool LidarChannel::admit(const Packet& packet) {
  if (!is_data_packet(packet) && !is_position_packet(packet)) {
    if (is_identified()) return true;
    count(packet, past_);
    ++packets_skipped_;
    return false;
  }
  const SenderSelection::Verdict verdict = selection_.examine(packet);
  if (verdict == SenderSelection::Verdict::kForeign) {
    note_foreign(packet);
    return false;
  }
  if (verdict == SenderSelection::Verdict::kOwn && is_identified()) {
    if (identification_ && is_data_packet(packet)) handle(identification_->add(packet));
    return true;
  }
  const std::size_t limit = verdict == SenderSelection::Verdict::kUndecided ? kMaxUndecided : kMaxBuffered;
  if (buffered_.size() >= limit && verdict != SenderSelection::Verdict::kSelected) discard_buffered();
  buffered_.push_back(packet);
  if (verdict == SenderSelection::Verdict::kSelected) on_sender();
  if (verdict != SenderSelection::Verdict::kUndecided) identify_buffered();
  return false;
}

/// A sender was selected: the first one, or another one than before.
void LidarChannel::on_sender() {
  if (std::exchange(has_sender_, true)) {
    LidarEvent event;
    event.kind = LidarEvent::Kind::kSenderChanged;
    copy_name(section_, event.section);
    event.sender = *selection_.sender();
    log_.report(event);
    if (!is_given_) on_other_sensor();
  }
  discard_foreign();
}

/// The sensor behind another address may be another one.
void LidarChannel::on_other_sensor() {
  if (assembler_) {
    assembler_->finish();
    add_to(past_, assembler_->stats());
  }
  assembler_.reset();
  reported_ = {};
  is_other_sensor_ = true;
  status_reported_ = false;
  set_identified(false);
  begin_identification();
}

/// Keeps the buffered packets of the selected sender.
void LidarChannel::discard_foreign() {
  const auto is_foreign = [this](const Packet& packet) {
    if (packet.sender_address == selection_.sender()) return false;
    note_foreign(packet);
    return true;
  };
  buffered_.erase(std::remove_if(buffered_.begin(), buffered_.end(), is_foreign), buffered_.end());
}

void LidarChannel::note_foreign(const Packet& packet) {
  foreign_packets_.fetch_add(1, std::memory_order_relaxed);
  ++packets_skipped_;
  if (!is_data_packet(packet) || !selection_.is_first_of(packet.sender_address)) return;
  LidarEvent event;
  event.kind = LidarEvent::Kind::kForeignSender;
  copy_name(section_, event.section);
  event.sender = *selection_.sender();
  event.other_sender = packet.sender_address;
  log_.report(event);
}

/// Passes buffered packets to the identification until it decides.
void LidarChannel::identify_buffered() {
  if (assembler_) set_identified(true);
  while (identification_ && examined_ < buffered_.size()) {
    const Packet& packet = buffered_[examined_++];
    if (is_data_packet(packet)) handle(identification_->add(packet));
  }
}

bool LidarChannel::decode_front() {
  const bool is_buffered = next_ < buffered_.size();
  const Packet& packet = is_buffered ? buffered_[next_] : ring_.begin_read().front();
  last_stamp_ = packet.stamp;
  if (first_received_ns_ == 0) first_received_ns_ = packet.received_ns;
  const bool is_backlog = packet.received_ns < first_received_ns_ + kStartBacklogNs;
  if (is_buffered || is_backlog) caught_up_ns_ = monotonic_ns();
  // A receive time of 0 means unknown.
  is_catching_up_ = is_buffered || (packet.received_ns > 0 && packet.received_ns < caught_up_ns_);
  const bool complete = is_catching_up_ ? add_delayed(packet) : assembler_->add(packet);
  if (imu_ring_ != nullptr && is_position_packet(packet)) pass_on_imu_samples(packet);
  ++packets_decoded_;
  if (is_buffered) {
    ++next_;
  } else {
    consume_front();
  }
  return complete;
}

/// Decodes a delayed packet with the current time as receive time: its deadline starts now.
bool LidarChannel::add_delayed(const Packet& packet) {
  delayed_ = packet;
  delayed_.received_ns = monotonic_ns();
  return assembler_->add(delayed_);
}

void LidarChannel::use_own_imu(ipc::Ring<core::ImuSample>& ring, core::Duration time_offset) {
  imu_ring_ = &ring;
  imu_time_offset_ = time_offset;
}

void LidarChannel::pass_on_imu_samples(const Packet& packet) {
  const std::optional<drivers::PositionPacket> position =
      drivers::parse_position_packet(std::span(packet.data).first(drivers::kPositionPacketSize));
  if (!position || !position->motion) return;
  const std::optional<core::Time> time = assembler_->time_of(position->timestamp_us);
  if (!time) return;
  imu_.add(*position->motion, *time - imu_time_offset_);
  while (const std::optional<core::ImuSample> sample = imu_.take()) imu_ring_->try_push(*sample);
}

void LidarChannel::take_scan(core::Scan& scan) {
  assembler_->take_scan(scan);
  scan.sequence += past_.scans;
  scan.after_time_jump = scan.after_time_jump || std::exchange(is_other_sensor_, false);
  report_resets(scan);
  if (++scans_taken_ == kScansToStatus) report_status();
}

/// Reports each clock that was set and each change of the return mode since the last scan.
void LidarChannel::report_resets(const core::Scan& scan) {
  using Stats = drivers::ScanAssemblerStats;
  constexpr std::array kResets{std::pair(&Stats::time_jumps, LidarEvent::Kind::kClockSet),
                               std::pair(&Stats::host_clock_jumps, LidarEvent::Kind::kHostClockSet),
                               std::pair(&Stats::mode_changes, LidarEvent::Kind::kModeChanged)};
  const Stats& stats = assembler_->stats();
  for (const auto& [counter, kind] : kResets) {
    if (stats.*counter <= reported_.*counter) continue;
    LidarEvent event;
    event.kind = kind;
    copy_name(section_, event.section);
    event.sequence = scan.sequence;
    event.status = assembler_->status();
    log_.report(event);
  }
  reported_ = stats;
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

void LidarChannel::report_identification(const SensorIdentification& identification) {
  for (const std::string& note : identification.notes()) log(LogLevel::kInfo, note);
  for (const std::string& warning : identification.warnings()) log_.log(LogLevel::kWarning, warning);
}

void LidarChannel::handle(SensorIdentification::State state) {
  if (state == SensorIdentification::State::kIdentified) {
    report_identification(*identification_);
    if (!assembler_) assembler_.emplace(identification_->take(), assembler_config_);
    identification_.reset();
    set_identified(true);
  } else if (state == SensorIdentification::State::kRejected) {
    const std::string& problem = identification_->problem();
    const bool is_new =
        std::find(problems_logged_.begin(), problems_logged_.end(), problem) == problems_logged_.end();
    const bool is_decoded = assembler_.has_value();
    if (is_new && problems_logged_.size() < kMaxProblemsLogged) {
      problems_logged_.push_back(problem);
      if (is_decoded) log(LogLevel::kWarning, problem);
      if (!is_decoded) log(LogLevel::kError, problem + "; no poses until this is resolved");
    }
    // The configured model is used all the same.
    if (is_decoded) {
      identification_.reset();
    } else {
      discard_buffered();
    }
  }
}

/// The input has ended: decides from what has arrived.
void LidarChannel::end_identification() {
  if (!selection_.sender()) {
    if (!selection_.finish()) return discard_buffered();
    on_sender();
    identify_buffered();
  }
  if (!is_identified() && identification_ && !buffered_.empty()) handle(identification_->finish());
  if (!is_identified()) discard_buffered();
}

void LidarChannel::discard_buffered() {
  for (const Packet& packet : buffered_) count(packet, past_);
  packets_skipped_ += buffered_.size();
  buffered_.clear();
  examined_ = 0;
}

/// Frees the buffer once all of its packets are decoded.
void LidarChannel::release_buffer() {
  if (!is_identified() || buffered_.empty()) return;
  buffered_ = {};
  examined_ = next_ = 0;
}

drivers::ScanAssemblerStats LidarChannel::stats() const {
  drivers::ScanAssemblerStats stats = past_;
  if (assembler_) add_to(stats, assembler_->stats());
  for (const Packet& packet : std::span(buffered_).subspan(next_)) count(packet, stats);
  stats.lost_packets -= std::min(stats.lost_packets, receive_state_.data_dropped.load());
  return stats;
}

}  // namespace nilio::daemon
