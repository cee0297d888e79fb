#pragma once

#include "nilio/drivers/source.hpp"

#include "ipc/ring.hpp"

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <span>
#include <utility>
#include <vector>

namespace nilio::tools::record {

/// A source and the ring between its receive thread and the writer.
template <class Slot>
struct RecordChannel {
  RecordChannel(std::unique_ptr<drivers::Source<Slot>> opened, std::size_t slots)
      : source(std::move(opened)), ring(ipc::Ring<Slot>::in_private_memory(slots)) {}

  std::unique_ptr<drivers::Source<Slot>> source;
  ipc::Ring<Slot> ring;
  std::atomic<bool> failed{false};
};

/// Body of a receive thread: receives in place. When the ring is full, packets are read from the socket,
/// counted and dropped. After `stop` it empties the socket, with at most kDrainReads reads.
template <class Slot>
void receive_into_ring(RecordChannel<Slot>& channel, const std::atomic<bool>& stop) {
  constexpr std::size_t kBatch = 64;
  constexpr int kDrainReads = 1000;
  constexpr core::Duration kTimeout{50'000'000};
  const auto overflow = std::make_unique<std::array<Slot, kBatch>>();
  for (int reads_left = kDrainReads; reads_left > 0;) {
    const bool stopping = stop.load(std::memory_order_relaxed);
    if (stopping) --reads_left;
    const std::span<Slot> slots = channel.ring.begin_write(kBatch);
    const drivers::SourceRead read = channel.source->read(slots.empty() ? std::span<Slot>(*overflow) : slots,
                                                          stopping ? core::Duration{} : kTimeout);
    if (slots.empty()) {
      channel.ring.count_dropped(read.count);
    } else {
      channel.ring.commit(read.count);
    }
    if (read.state == drivers::SourceState::kIdle && stopping) return;
    if (read.state == drivers::SourceState::kEnd || read.state == drivers::SourceState::kFailed) {
      channel.failed.store(read.state == drivers::SourceState::kFailed);
      return;
    }
  }
}

/// Slots that may be delivered: stamped so long ago that no older one can still arrive or, if the host's
/// clock was set, received long ago.
struct RingHorizon {
  core::Time stamp;
  std::int64_t received_ns = 0;  ///< CLOCK_MONOTONIC
};

/// Merges rings into one stream in order of stamps, which are in order within each ring.
template <class Slot>
class RingMerger {
 public:
  explicit RingMerger(const std::vector<std::unique_ptr<RecordChannel<Slot>>>& channels) {
    for (const auto& channel : channels) inputs_.push_back({&channel->ring, {}, 0});
  }

  /// Delivers every slot within the horizon, with the number of its channel.
  template <class Consumer>
  void drain(const RingHorizon& horizon, Consumer consume) {
    for (;;) {
      const Slot* first = nullptr;
      std::size_t channel = 0;
      for (std::size_t i = 0; i < inputs_.size(); ++i) {
        const Slot* slot = front(inputs_[i]);
        if (slot == nullptr || (slot->stamp > horizon.stamp && slot->received_ns > horizon.received_ns))
          continue;
        if (first != nullptr && slot->stamp >= first->stamp) continue;
        first = slot;
        channel = i;
      }
      if (first == nullptr) break;
      consume(*first, channel);
      ++inputs_[channel].used;
    }
    for (Input& input : inputs_) give_back(input);
  }

 private:
  struct Input {
    ipc::Ring<Slot>* ring;
    std::span<const Slot> slots;
    std::size_t used;
  };

  static void give_back(Input& input) {
    input.ring->consume(input.used);
    input.slots = {};
    input.used = 0;
  }

  static const Slot* front(Input& input) {
    if (input.used == input.slots.size()) {
      give_back(input);
      input.slots = input.ring->begin_read();
    }
    return input.slots.empty() ? nullptr : &input.slots[input.used];
  }

  std::vector<Input> inputs_;
};

}  // namespace nilio::tools::record
