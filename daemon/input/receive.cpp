#include "daemon/input/receive.hpp"

#include "nilio/core/clock.hpp"
#include "nilio/drivers/velodyne/packet.hpp"

#include <algorithm>
#include <ctime>
#include <utility>

namespace nilio::daemon {

namespace {

using core::Duration;
using drivers::SourceState;

constexpr Duration kReadTimeout = Duration::from_milliseconds(50.0);
constexpr std::int64_t kRoomPollNs = 200'000;
constexpr std::int64_t kLongestSleepNs = 50'000'000;

void sleep_ns(std::int64_t ns) {
  const timespec wanted = to_timespec({ns});
  nanosleep(&wanted, nullptr);
}

/// Lets packets gather in the socket, for fewer wake-ups: their stamps are the kernel's all the same.
void gather(const std::atomic<std::int64_t>& until_ns) {
  const std::int64_t left_ns = until_ns.load(std::memory_order_relaxed) - monotonic_ns();
  if (left_ns > 0) sleep_ns(std::min(left_ns, kGatherTime.ns));
}

std::uint64_t count_data(std::span<const drivers::Packet> packets) {
  return static_cast<std::uint64_t>(std::count_if(packets.begin(), packets.end(), drivers::is_data_packet));
}

/// Waits for the due time, for at most kLongestSleepNs; true if it is due.
bool wait_until_due(core::Time stamp, const std::optional<Pace>& pace) {
  if (!pace) return true;
  const std::int64_t left = pace->start_ns + (stamp - pace->origin).ns - monotonic_ns();
  if (left > 0) sleep_ns(std::min(left, kLongestSleepNs));
  return left <= kLongestSleepNs;
}

/// Records a failed source; true if the source has ended.
bool has_ended(SourceState read_state, ReceiveState& state) {
  if (read_state == SourceState::kFailed) state.failed.store(true);
  return read_state != SourceState::kData && read_state != SourceState::kIdle;
}

void announce_end(ReceiveState& state, ipc::WakeEvent& data_event) {
  state.ended.store(true, std::memory_order_release);
  data_event.notify();
}

}  // namespace

PacketReceiver::PacketReceiver(drivers::PacketSource& source, ipc::Ring<drivers::Packet>& ring,
                               ipc::WakeEvent& data_event, const ReceivePolicy& policy, ReceiveState& state,
                               ipc::Ring<drivers::Packet>* recorded)
    : source_(source),
      ring_(ring),
      data_event_(data_event),
      policy_(policy),
      state_(state),
      recorded_(recorded),
      overflow_(std::make_unique<std::array<drivers::Packet, kBatch>>()) {}

bool PacketReceiver::run() {
  if (state_.stop.load(std::memory_order_relaxed)) return false;
  if (held_.empty()) {
    if (at_end_) return false;
    std::span<drivers::Packet> slots = ring_.begin_write(policy_.pace ? 1 : kBatch);
    if (slots.empty() && !policy_.rules.are_live()) {
      sleep_ns(kRoomPollNs);
      return true;
    }
    const bool dropped = slots.empty();
    if (dropped) slots = *overflow_;
    const drivers::SourceRead read = source_.read(slots, kReadTimeout);
    at_end_ = has_ended(read.state, state_);
    if (dropped) {
      ring_.count_dropped(read.count);
      data_dropped_ += count_data(slots.first(read.count));
    } else {
      held_ = slots.first(read.count);
    }
    if (held_.empty()) return !at_end_;
  }
  if (!wait_until_due(held_.front().stamp, policy_.pace)) return true;
  if (policy_.pace) held_.front().received_ns = monotonic_ns();
  if (recorded_ != nullptr) {
    for (const drivers::Packet& packet : held_) recorded_->try_push(packet);
  }
  ring_.commit(std::exchange(held_, {}).size());
  data_event_.notify();
  if (policy_.gather_until_ns != nullptr) gather(*policy_.gather_until_ns);
  return true;
}

void PacketReceiver::finish() {
  state_.data_dropped.store(source_.stats().kernel_dropped + data_dropped_);
  announce_end(state_, data_event_);
}

ImuReceiver::ImuReceiver(drivers::FrameSource& source, std::optional<drivers::ImuDecoder>& decoder,
                         drivers::ImuIdentification* identification, ipc::Ring<core::ImuSample>& ring,
                         ipc::WakeEvent& data_event, const ReceivePolicy& policy, ReceiveState& state,
                         ipc::PublisherProcess* publisher, ipc::Ring<drivers::CanFrame>* recorded)
    : source_(source),
      decoder_(decoder),
      identification_(identification),
      ring_(ring),
      data_event_(data_event),
      policy_(policy),
      state_(state),
      publisher_(publisher),
      recorded_(recorded),
      frames_(std::make_unique<std::array<drivers::CanFrame, kBatch>>()) {}

bool ImuReceiver::run() {
  if (state_.stop.load(std::memory_order_relaxed)) return false;
  if (waiting_.empty()) {
    if (!deliver_backlog()) {
      sleep_ns(kRoomPollNs);
      return true;
    }
    if (at_end_) return false;
    const drivers::SourceRead read = source_.read(*frames_, kReadTimeout);
    at_end_ = has_ended(read.state, state_);
    waiting_ = std::span(*frames_).first(read.count);
  }
  while (!waiting_.empty() && take(waiting_.front())) waiting_ = waiting_.subspan(1);
  return true;
}

bool ImuReceiver::take(const drivers::CanFrame& frame) {
  // A full ring leaves frames in the socket, where the kernel counts those it drops: every frame that was
  // read reaches the odometry, so that a recorded run can be repeated.
  if (!deliver_backlog() || ring_.begin_write(1).empty()) {
    sleep_ns(kRoomPollNs);
    return false;
  }
  if (!wait_until_due(frame.stamp, policy_.pace)) return false;
  if (recorded_ != nullptr) recorded_->try_push(frame);
  if (!decoder_) {
    if (!identification_->add(frame)) return true;
    decoder_.emplace(identification_->take_decoder());
    backlog_ = identification_->samples();
    return true;
  }
  if (const std::optional<core::ImuSample> sample = decoder_->add(frame)) deliver(*sample, frame.received_ns);
  return true;
}

/// True if nothing of it is left.
bool ImuReceiver::deliver_backlog() {
  while (!backlog_.empty() && !ring_.begin_write(1).empty()) {
    deliver(backlog_.front().sample, backlog_.front().received_ns);
    backlog_ = backlog_.subspan(1);
  }
  return backlog_.empty();
}

void ImuReceiver::deliver(const core::ImuSample& sample, std::int64_t received_ns) {
  if (publisher_ != nullptr)
    publisher_->publish_sample({sample, policy_.pace ? monotonic_ns() : received_ns});
  ring_.try_push(sample);
  if (state_.is_awaited.load(std::memory_order_seq_cst)) data_event_.notify();
}

void ImuReceiver::finish() { announce_end(state_, data_event_); }

SampleReceiver::SampleReceiver(drivers::SampleSource& source, ipc::Ring<core::ImuSample>& ring,
                               ipc::WakeEvent& data_event, const ReceivePolicy& policy, ReceiveState& state,
                               ipc::PublisherProcess* publisher)
    : source_(source),
      ring_(ring),
      data_event_(data_event),
      policy_(policy),
      state_(state),
      publisher_(publisher) {}

bool SampleReceiver::run() {
  if (state_.stop.load(std::memory_order_relaxed)) return false;
  if (waiting_.empty()) {
    if (at_end_) return false;
    const drivers::SourceRead read = source_.read(samples_, kReadTimeout);
    at_end_ = has_ended(read.state, state_);
    waiting_ = std::span(samples_).first(read.count);
  }
  for (; !waiting_.empty(); waiting_ = waiting_.subspan(1)) {
    const core::ImuSample& sample = waiting_.front();
    if (ring_.begin_write(1).empty()) {
      sleep_ns(kRoomPollNs);
      return true;
    }
    if (!wait_until_due(sample.stamp, policy_.pace)) return true;
    if (publisher_ != nullptr) publisher_->publish_sample({sample, monotonic_ns()});
    ring_.try_push(sample);
    if (state_.is_awaited.load(std::memory_order_seq_cst)) data_event_.notify();
  }
  return true;
}

void SampleReceiver::finish() { announce_end(state_, data_event_); }

}  // namespace nilio::daemon
