#include "tools/record/session.hpp"

#include "nilio/core/clock.hpp"
#include "nilio/drivers/can/can_files.hpp"
#include "nilio/drivers/can/socketcan/socketcan.hpp"
#include "nilio/drivers/capture/pcap.hpp"
#include "nilio/drivers/network/udp.hpp"

#include <bit>
#include <cstring>
#include <ctime>
#include <limits>
#include <pthread.h>

namespace nilio::tools::record {

namespace {

using core::Error;
using core::Result;
using drivers::CanFrame;
using drivers::Packet;

/// A position packet is sent with every fifth to fourteenth data packet.
constexpr std::size_t kPositionSlots = 8192;
/// 5 s of a full bus.
constexpr std::size_t kCanSlots = 16384;
constexpr std::int64_t kWritePeriodNs = 20'000'000;
constexpr std::int64_t kFlushPeriodNs = 200'000'000;
constexpr std::int64_t kSyncPeriodNs = 1'000'000'000;
/// Time that slots wait for older ones of other sockets, whose threads may be late; the second value after
/// the clock was set.
constexpr std::int64_t kMergeNs = 100'000'000;
constexpr std::int64_t kLongestMergeNs = 250'000'000;

template <class Channels>
void add_channels(const Channels& channels, RecordProgress& progress, bool& any_alive) {
  for (const auto& channel : channels) {
    const drivers::SourceStats stats = channel->source->stats();
    progress.received += stats.delivered;
    progress.kernel_dropped += stats.kernel_dropped;
    progress.ring_dropped += channel->ring.dropped();
    any_alive = any_alive || !channel->failed.load();
  }
}

template <class Channels>
void add_lines(const Channels& channels, bool silent_only, std::vector<std::string>& lines) {
  for (const auto& channel : channels) {
    if (silent_only && channel->source->stats().delivered > 0 && !channel->failed.load()) continue;
    lines.push_back(channel->source->status());
  }
}

}  // namespace

Result<std::unique_ptr<RecordSession>> RecordSession::open(const RecordConfig& config,
                                                           drivers::RecordParts::Report report) {
  std::unique_ptr<RecordSession> session(new RecordSession(config, std::move(report)));
  if (const Result<std::size_t> opened = session->open_sources(); !opened) return opened.error();
  Result<drivers::RecordParts> parts =
      drivers::RecordParts::create(config.folder, config.limits, session->counters_, session->report_);
  if (!parts) return parts.error();
  session->parts_ = std::make_unique<drivers::RecordParts>(std::move(parts).value());
  session->lidar_merger_ = std::make_unique<RingMerger<Packet>>(session->lidar_);
  session->can_merger_ = std::make_unique<RingMerger<CanFrame>>(session->can_);
  return session;
}

RecordSession::~RecordSession() { stop(); }

Result<std::size_t> RecordSession::open_sources() {
  if (config_.data_port == 0 && config_.position_port == 0 && config_.can_interfaces.empty())
    return Error{"no source to record: both ports are 0 and no --can is given"};
  if (config_.data_port != 0 && config_.data_port == config_.position_port)
    return Error{"--port and --position-port are both " + std::to_string(config_.data_port) +
                 ": a socket receives both kinds then, set --position-port 0"};
  const std::size_t slots = std::max<std::size_t>(config_.ring_bytes / sizeof(Packet), 1024);
  if (config_.data_port != 0) {
    // A ring rounds up; stay within the requested memory.
    if (const auto added = add_udp(config_.data_port, std::bit_floor(slots)); !added) return added.error();
  }
  if (config_.position_port != 0) {
    if (const auto added = add_udp(config_.position_port, kPositionSlots); !added) return added.error();
  }
  for (const std::string& name : config_.can_interfaces) {
    if (const auto added = add_can(name); !added) return added.error();
  }
  return lidar_.size() + can_.size();
}

Result<std::size_t> RecordSession::add_udp(std::uint16_t port, std::size_t slots) {
  drivers::UdpSourceConfig config;
  config.bind_address = config_.bind_address;
  config.port = port;
  // One channel per port: within one, stamps are in order.
  config.position_port = 0;
  config.sender_address = config_.sender_address;
  config.multicast_group = config_.multicast_group;
  config.multicast_interface = config_.multicast_interface;
  config.receive_buffer_bytes = config_.receive_buffer_bytes;
  auto source = drivers::open_udp_or_tap(config);
  if (!source) return source.error();
  lidar_.push_back(std::make_unique<RecordChannel<Packet>>(std::move(source).value(), slots));
  return lidar_.size();
}

Result<std::size_t> RecordSession::add_can(const std::string& interface_name) {
  drivers::SocketCanConfig config;
  config.interface_name = interface_name;
  auto source = drivers::open_socketcan(config);
  if (!source) return source.error();
  auto channel = std::make_unique<RecordChannel<CanFrame>>(std::move(source).value(), kCanSlots);
  can_.push_back(std::move(channel));
  return can_.size();
}

/// Priority of the calling thread.
void RecordSession::set_priority(const char* thread_name) {
  pthread_setname_np(pthread_self(), thread_name);
  if (config_.priority == 0) return;
  const sched_param parameters{config_.priority};
  if (const int error = pthread_setschedparam(pthread_self(), SCHED_FIFO, &parameters); error != 0)
    report_(std::string(thread_name) + ": priority FIFO " + std::to_string(config_.priority) + " refused (" +
            std::strerror(error) +
            "): packets may be lost under load; grant CAP_SYS_NICE or LimitRTPRIO, or set --priority 0");
}

void RecordSession::start() {
  writer_ = std::thread([this] { write_until_finished(); });
  for (const auto& channel : lidar_) {
    receivers_.emplace_back([this, &channel = *channel] {
      set_priority("record-lidar");
      receive_into_ring(channel, stop_receiving_);
    });
  }
  for (const auto& channel : can_) {
    receivers_.emplace_back([this, &channel = *channel] {
      set_priority("record-can");
      receive_into_ring(channel, stop_receiving_);
    });
  }
}

void RecordSession::stop() {
  stop_receiving_.store(true);
  for (std::thread& receiver : receivers_) receiver.join();
  receivers_.clear();
  stop_writing_.store(true);
  if (writer_.joinable()) writer_.join();
}

void RecordSession::write_until_finished() {
  pthread_setname_np(pthread_self(), "record-writer");
  std::int64_t flushed_ns = monotonic_ns();
  std::int64_t synced_ns = flushed_ns;
  while (!stop_writing_.load()) {
    const timespec pause{0, kWritePeriodNs};
    nanosleep(&pause, nullptr);
    drain({.stamp = {clock_ns(CLOCK_REALTIME) - kMergeNs}, .received_ns = monotonic_ns() - kLongestMergeNs});
    const std::int64_t now = monotonic_ns();
    if (now - flushed_ns >= kFlushPeriodNs) {
      parts_->flush(now);
      flushed_ns = now;
    }
    if (now - synced_ns >= kSyncPeriodNs) {
      parts_->sync();
      synced_ns = now;
    }
  }
  constexpr std::int64_t kForEver = std::numeric_limits<std::int64_t>::max();
  drain({.stamp = {kForEver}, .received_ns = kForEver});
  parts_->close(monotonic_ns());
}

void RecordSession::drain(const RingHorizon& horizon) {
  const std::int64_t now = monotonic_ns();
  lidar_merger_->drain(horizon, [&](const Packet& packet, std::size_t /*channel*/) {
    record_.clear();
    // Only a host clock before 1970 or after 2106 gives stamps that a capture cannot store.
    if (drivers::append_pcap_record(record_, packet)) {
      parts_->append(drivers::RecordStream::kLidar, record_, now);
    } else {
      unrecordable_.fetch_add(1);
    }
  });
  can_merger_->drain(horizon, [&](const CanFrame& frame, std::size_t channel) {
    const std::string line = drivers::format_candump_line(frame, config_.can_interfaces[channel]) + "\n";
    record_.assign(line.begin(), line.end());
    parts_->append(drivers::RecordStream::kCan, record_, now);
  });
}

RecordProgress RecordSession::progress() const {
  RecordProgress progress;
  bool any_alive = false;
  add_channels(lidar_, progress, any_alive);
  add_channels(can_, progress, any_alive);
  progress.packets = counters_.written[0].load();
  progress.frames = counters_.written[1].load();
  progress.disk_lost = counters_.lost[0].load() + counters_.lost[1].load() + unrecordable_.load();
  progress.bytes = counters_.bytes.load();
  progress.files = counters_.files.load();
  progress.deleted = counters_.deleted.load();
  progress.part = counters_.part.load();
  progress.blocked = counters_.blocked.load();
  progress.all_sources_failed = !any_alive;
  return progress;
}

std::vector<std::string> RecordSession::source_lines(bool silent_only) const {
  std::vector<std::string> lines;
  add_lines(lidar_, silent_only, lines);
  add_lines(can_, silent_only, lines);
  return lines;
}

}  // namespace nilio::tools::record
