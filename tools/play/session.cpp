#include "tools/play/session.hpp"

#include "nilio/drivers/can/can_files.hpp"
#include "nilio/drivers/capture/pcap.hpp"

#include "tools/common/system.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <utility>

namespace nilio::tools::play {

namespace {

using core::Error;
using core::Result;
using drivers::CanFrame;
using drivers::Packet;

constexpr std::size_t kLookahead = 256;
constexpr std::int64_t kStopCheckNs = 20'000'000;
/// An interface's queue of 10 frames is empty after some milliseconds, unless no node acknowledges them.
constexpr int kCanAttempts = 100;
constexpr std::int64_t kCanRetryNs = 1'000'000;
constexpr core::Duration kDistantStart{10'000'000'000};

std::string seconds_text(core::Duration duration) {
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "%.3f s", duration.seconds());
  return text.data();
}

}  // namespace

template <class Slot>
const Slot* PlaySession::Lookahead<Slot>::front() {
  if (next < count) return &slots[next];
  if (!source) return nullptr;
  const drivers::SourceRead read = source->read(slots, core::Duration{});
  next = 0;
  count = read.state == drivers::SourceState::kData ? read.count : 0;
  return count > 0 ? slots.data() : nullptr;
}

PlaySession::PlaySession(PlayConfig config, Report report)
    : config_(std::move(config)), report_(std::move(report)), timeline_(config_.speed, config_.longest_gap) {
  packets_.slots.resize(kLookahead);
  frames_.slots.resize(kLookahead);
  batch_.reserve(PacketSender::kBatch);
  batch_due_ns_.reserve(PacketSender::kBatch);
}

Result<std::unique_ptr<PlaySession>> PlaySession::open(const PlayConfig& config, Report report) {
  std::unique_ptr<PlaySession> session(new PlaySession(config, std::move(report)));
  if (config.captures.empty() && (config.can_logs.empty() || config.can_interface.empty()))
    return Error{config.can_logs.empty() ? "no input to play: there is no capture and no CAN log"
                                         : "no input to play: there is no capture, and CAN logs need --can"};
  if (config.can_logs.empty() && !config.can_interface.empty())
    return Error{"--can " + config.can_interface + ": the recording has no CAN log; leave the option out"};
  if (config.restamp && (config.fast || config.speed != 1.0))
    return Error{
        "--restamp needs the recording's own pace: at another, the sensor's clock would not keep up with the "
        "host's; leave out --speed and --fast"};
  if (!config.captures.empty()) {
    Result<PacketSender> sender = PacketSender::open(config.sender);
    if (!sender) return sender.error();
    session->packet_sender_.emplace(std::move(sender).value());
  }
  if (!config.can_interface.empty()) {
    Result<drivers::CanSender> sender = drivers::CanSender::open(config.can_interface);
    if (!sender) return sender.error();
    session->can_sender_.emplace(std::move(sender).value());
  }
  if (const Result<std::size_t> opened = session->open_sources(); !opened) return opened.error();
  session->warn_of_distant_starts();
  return session;
}

Result<std::size_t> PlaySession::open_sources() {
  packets_.count = packets_.next = 0;
  frames_.count = frames_.next = 0;
  if (packet_sender_) {
    auto source = drivers::chain_captures(
        config_.captures,
        {.data_port = config_.recorded_port, .position_port = config_.recorded_position_port});
    if (!source) return source.error();
    packets_.source = std::move(source).value();
    if (packets_.front() == nullptr)
      return Error{packets_.source->status() + " (--recorded-port, --recorded-position-port)"};
  }
  if (can_sender_) {
    auto source = drivers::chain_can_logs(config_.can_logs, "");
    if (!source) return source.error();
    frames_.source = std::move(source).value();
    if (frames_.front() == nullptr) return Error{frames_.source->status()};
  }
  return std::size_t{packet_sender_ ? 1U : 0U} + (can_sender_ ? 1U : 0U);
}

void PlaySession::warn_of_distant_starts() {
  const Packet* packet = packets_.front();
  const CanFrame* frame = frames_.front();
  if (packet != nullptr) first_stamp_ = packet->stamp;
  if (frame != nullptr && (packet == nullptr || frame->stamp < first_stamp_)) first_stamp_ = frame->stamp;
  if (packet == nullptr || frame == nullptr) return;
  const core::Duration apart = packet->stamp - frame->stamp;
  if (std::abs(apart.ns) < kDistantStart.ns) return;
  report_("the CAN log begins " + seconds_text(apart.ns > 0 ? apart : -apart) +
          (apart.ns > 0 ? " before" : " after") +
          " the capture; they are played by their stamps - check that they belong together");
}

PlayReport PlaySession::run(const std::function<bool()>& stop_wanted) {
  stop_wanted_ = &stop_wanted;
  for (;;) {
    const bool complete = play_once();
    send_batch();
    if (complete) ++result_.loops;
    if (!complete || (config_.loops != 0 && result_.loops >= config_.loops)) break;
    if (const Result<std::size_t> opened = open_sources(); !opened) {
      report_(opened.error().message);
      break;
    }
    timeline_.restart();
  }
  if (packets_.source && packets_.source->stats().malformed > 0) report_(packets_.source->status());
  if (frames_.source && frames_.source->stats().malformed > 0) report_(frames_.source->status());
  const ipc::HistogramSnapshot late = lateness_.snapshot();
  result_.late_p50_ns = late.percentile(50.0);
  result_.late_p99_ns = late.percentile(99.0);
  result_.late_max_ns = late_max_ns_;
  return result_;
}

/// False if stopped before the end.
bool PlaySession::play_once() {
  for (;;) {
    const Packet* packet = packets_.front();
    const CanFrame* frame = frames_.front();
    if (packet == nullptr && frame == nullptr) return true;
    const bool is_packet = packet != nullptr && (frame == nullptr || packet->stamp <= frame->stamp);
    const core::Time stamp = is_packet ? packet->stamp : frame->stamp;
    const PlayTimeline::Due due = timeline_.next(stamp, monotonic_ns());
    if (due.event != PlayTimeline::Event::kNone) note_event(due, stamp);
    if (!wait_until_due(due)) return false;
    if (is_packet) {
      add_packet(*packet, due);
      ++packets_.next;
    } else {
      send_batch();
      send_frame(*frame, due);
      ++frames_.next;
    }
  }
}

/// False if stopped.
bool PlaySession::wait_until_due(const PlayTimeline::Due& due) {
  std::int64_t now = monotonic_ns();
  if (config_.fast || due.due_ns <= now) return !is_stopped(now);
  send_batch();
  for (;;) {
    now = monotonic_ns();
    if (is_stopped(now)) return false;
    if (due.due_ns <= now) return true;
    sleep_until(std::min(due.due_ns, now + kStopCheckNs));
  }
}

bool PlaySession::is_stopped(std::int64_t now_ns) {
  if (stopped_ || now_ns < next_stop_check_ns_) return stopped_;
  next_stop_check_ns_ = now_ns + kStopCheckNs;
  stopped_ = (*stop_wanted_)();
  return stopped_;
}

void PlaySession::add_packet(const Packet& packet, const PlayTimeline::Due& due) {
  if (packet.truncated) {
    ++result_.skipped;
    return;
  }
  Packet& copy = batch_.emplace_back(packet);
  batch_due_ns_.push_back(due.due_ns);
  const bool is_position = packet.destination_port == config_.recorded_position_port;
  const std::uint16_t port = is_position ? config_.position_port : config_.port;
  if (port != 0) copy.destination_port = port;
  if (config_.restamp) restamper_.apply(copy, {clock_ns(CLOCK_REALTIME)});
  if (batch_.size() == PacketSender::kBatch) send_batch();
}

void PlaySession::send_batch() {
  if (batch_.empty()) return;
  const std::int64_t now = monotonic_ns();
  for (const std::int64_t due : batch_due_ns_) note_late(due, now);
  const PacketSender::Sent sent = packet_sender_->send(batch_);
  if (sent.failed > 0 && result_.packets_failed == 0)
    report_("sending to " + config_.sender.destination_address + " failed (" + std::strerror(sent.error) +
            "); check --to, --from and the route with 'ip route get " + config_.sender.destination_address +
            "'");
  result_.packets += sent.packets;
  result_.packets_failed += sent.failed;
  batch_.clear();
  batch_due_ns_.clear();
}

void PlaySession::send_frame(const CanFrame& frame, const PlayTimeline::Due& due) {
  if (frame.error) {
    ++result_.skipped;
    return;
  }
  note_late(due.due_ns, monotonic_ns());
  drivers::CanSendResult sent = can_sender_->send(frame);
  for (int i = 0; sent == drivers::CanSendResult::kQueueFull && i < kCanAttempts; ++i) {
    sleep_until(monotonic_ns() + kCanRetryNs);
    sent = can_sender_->send(frame);
  }
  if (sent == drivers::CanSendResult::kSent) {
    ++result_.frames;
    return;
  }
  if (result_.frames_failed++ > 0) return;
  const std::string where = "CAN " + config_.can_interface + ": a frame was not sent: ";
  if (sent == drivers::CanSendResult::kQueueFull)
    report_(where + "the bus accepts none (no acknowledge, or bus-off) - check wiring and bit rate");
  if (sent == drivers::CanSendResult::kDown)
    report_(where + "the interface is down; 'ip link set " + config_.can_interface + " up'");
  if (sent == drivers::CanSendResult::kRefused)
    report_(where + "it is refused; CAN FD frames need 'ip link set " + config_.can_interface +
            " mtu 72' or an interface that has them");
}

void PlaySession::note_event(const PlayTimeline::Due& due, core::Time stamp) {
  if (due.is_new_origin()) restamper_.restart();
  const std::string at = seconds_text(stamp - first_stamp_) + " after the start of the recording: ";
  switch (due.event) {
    case PlayTimeline::Event::kGap:
      if (!config_.fast) report_(at + "a gap of " + seconds_text(due.step) + ", kept");
      break;
    case PlayTimeline::Event::kGapSkipped:
      report_(at + "a gap of " + seconds_text(due.step) + ", skipped (--longest-gap)");
      break;
    case PlayTimeline::Event::kBackwards:
      report_(at + "the stamps jump back by " + seconds_text(-due.step) + ", playing continues there");
      break;
    case PlayTimeline::Event::kNone:
    case PlayTimeline::Event::kBegin:
      break;
  }
}

void PlaySession::note_late(std::int64_t due_ns, std::int64_t now_ns) {
  if (config_.fast) return;
  const std::int64_t late = std::max<std::int64_t>(now_ns - due_ns, 0);
  lateness_.record(late);
  late_max_ns_ = std::max(late_max_ns_, late);
}

}  // namespace nilio::tools::play
