#include "daemon/input/receive.hpp"

#include <algorithm>
#include <array>
#include <ctime>
#include <memory>
#include <span>

namespace nilio::daemon {

namespace {

using core::Duration;
using drivers::SourceState;

constexpr std::size_t kBatch = 64;
constexpr Duration kReadTimeout = Duration::from_milliseconds(50.0);
constexpr std::int64_t kRoomPollNs = 200'000;
constexpr std::int64_t kLongestSleepNs = 50'000'000;

void sleep_ns(std::int64_t ns) {
  const timespec wanted{ns / 1'000'000'000, ns % 1'000'000'000};
  nanosleep(&wanted, nullptr);
}

void wait_until_due(core::Time stamp, const Pace& pace, const std::atomic<bool>& stop) {
  const std::int64_t due = pace.start_ns + (stamp - pace.origin).ns;
  // Short sleeps keep the reaction to `stop` fast during long gaps in the recording.
  for (std::int64_t left = due - monotonic_ns(); left > 0 && !stop.load(); left = due - monotonic_ns()) {
    sleep_ns(std::min(left, kLongestSleepNs));
  }
}

/// Free slots: at least one, unless stopped or the policy is to drop.
template <class Slot>
std::span<Slot> find_room(ipc::Ring<Slot>& ring, std::size_t count, const ReceivePolicy& policy,
                          const ReceiveState& state) {
  std::span<Slot> slots = ring.begin_write(count);
  while (slots.empty() && policy.wait_when_full && !state.stop.load(std::memory_order_relaxed)) {
    sleep_ns(kRoomPollNs);
    slots = ring.begin_write(count);
  }
  return slots;
}

/// Records a failed source; true while the source delivers data.
bool record_end(SourceState read_state, ReceiveState& state) {
  if (read_state == SourceState::kFailed) state.failed.store(true);
  return read_state == SourceState::kData || read_state == SourceState::kIdle;
}

void call_hook(const ReceivePolicy& policy, ThreadRole role, ThreadPhase phase) {
  if (policy.hook != nullptr) policy.hook(role, phase);
}

void announce_end(ReceiveState& state, ipc::WakeEvent& data_event) {
  state.ended.store(true, std::memory_order_release);
  data_event.notify();
}

}  // namespace

void receive_packets(drivers::PacketSource& source, ipc::Ring<drivers::Packet>& ring,
                     ipc::WakeEvent& data_event, const ReceivePolicy& policy, ReceiveState& state) {
  const std::size_t batch = policy.pace ? 1 : kBatch;
  // Destination of packets when the ring is full: they must leave the socket to be counted.
  const auto overflow = std::make_unique<std::array<drivers::Packet, kBatch>>();
  bool running = true;
  call_hook(policy, ThreadRole::kLidarReceive, ThreadPhase::kSteady);
  while (running && !state.stop.load(std::memory_order_relaxed)) {
    state.heartbeat.fetch_add(1, std::memory_order_relaxed);
    const std::span<drivers::Packet> slots = find_room(ring, batch, policy, state);
    if (slots.empty()) {
      const drivers::SourceRead read = source.read(*overflow, kReadTimeout);
      ring.count_dropped(read.count);
      running = record_end(read.state, state);
      continue;
    }
    const drivers::SourceRead read = source.read(slots, kReadTimeout);
    if (read.count > 0) {
      if (policy.pace) {
        wait_until_due(slots[0].stamp, *policy.pace, state.stop);
        slots[0].received_ns = monotonic_ns();
      }
      ring.commit(read.count);
      data_event.notify();
    }
    running = record_end(read.state, state);
  }
  call_hook(policy, ThreadRole::kLidarReceive, ThreadPhase::kEnding);
  announce_end(state, data_event);
}

void receive_imu(drivers::FrameSource& source, drivers::ImuDecoder& decoder, ipc::Ring<core::ImuSample>& ring,
                 ipc::WakeEvent& data_event, const ReceivePolicy& policy, ReceiveState& state,
                 ipc::PublisherProcess* publisher) {
  const auto frames = std::make_unique<std::array<drivers::CanFrame, kBatch>>();
  bool running = true;
  call_hook(policy, ThreadRole::kImuReceive, ThreadPhase::kSteady);
  while (running && !state.stop.load(std::memory_order_relaxed)) {
    state.heartbeat.fetch_add(1, std::memory_order_relaxed);
    const drivers::SourceRead read = source.read(*frames, kReadTimeout);
    for (const drivers::CanFrame& frame : std::span(*frames).first(read.count)) {
      const std::optional<core::ImuSample> sample = decoder.add(frame);
      if (!sample) continue;
      if (policy.pace) wait_until_due(frame.stamp, *policy.pace, state.stop);
      if (publisher != nullptr)
        publisher->publish_sample({*sample, policy.pace ? monotonic_ns() : frame.received_ns});
      const std::span<core::ImuSample> slot = find_room(ring, 1, policy, state);
      if (slot.empty()) {
        ring.count_dropped(1);
        continue;
      }
      slot[0] = *sample;
      ring.commit(1);
      data_event.notify();
    }
    running = record_end(read.state, state);
  }
  call_hook(policy, ThreadRole::kImuReceive, ThreadPhase::kEnding);
  announce_end(state, data_event);
}

}  // namespace nilio::daemon
