#pragma once

#include "nilio/core/result.hpp"

#include "ipc/memory_block.hpp"

#include <algorithm>
#include <atomic>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <new>
#include <optional>
#include <span>
#include <string>
#include <type_traits>
#include <utility>

namespace nilio::ipc {

inline constexpr std::size_t kCacheLineBytes = 64;

/// Header of a ring's memory. Each side writes only its own cache line.
struct RingHeader {  // NOLINT(clang-analyzer-optin.performance.Padding): that is the point
  static constexpr std::uint64_t kMagic = 0x474E'4952'4F49'4C4E;  // "NLIORING", little endian
  static constexpr std::uint32_t kVersion = 1;

  std::uint64_t magic = kMagic;
  std::uint32_t version = kVersion;
  std::uint32_t slot_bytes = 0;
  std::uint64_t capacity = 0;
  // Written by the producer.
  alignas(kCacheLineBytes) std::atomic<std::uint64_t> written{0};
  std::atomic<std::uint64_t> dropped{0};
  std::atomic<std::uint64_t> high_water{0};
  std::atomic<std::uint64_t> impossible_fills{0};
  // Written by the consumer.
  alignas(kCacheLineBytes) std::atomic<std::uint64_t> consumed{0};
};
static_assert(std::atomic<std::uint64_t>::is_always_lock_free, "the indices are shared between processes");

/// Single-producer single-consumer ring with in-place slots, in private or shared memory (memfd). Both sides
/// are wait-free and do not allocate. The indices count slots since the start and never wrap, so the state
/// survives the end of either process: a killed reader is replaced by one that attaches and continues at the
/// first slot not consumed.
///
/// One thread produces, one thread consumes (with one Ring object, or with one each on the same shared
/// memory); size(), capacity() and the counters may be read by any thread. The producer validates the
/// consumer's index: an impossible value counts as a full ring.
template <class T>
class Ring {
  static_assert(std::is_trivially_copyable_v<T>);
  static_assert(alignof(T) <= kCacheLineBytes);

 public:
  /// Creates a ring in private memory. The capacity is rounded up to a power of two. Throws std::bad_alloc.
  static Ring in_private_memory(std::size_t capacity) {
    const std::size_t slots = std::bit_ceil(std::clamp<std::size_t>(capacity, 1, kMaxCapacity));
    return Ring(MemoryBlock::on_heap(memory_bytes(slots)), slots);
  }

  /// Creates a ring in shared memory. The capacity is rounded up to a power of two. The descriptor is
  /// close-on-exec.
  static core::Result<Ring> in_shared_memory(std::size_t capacity) {
    if (capacity > kMaxCapacity)
      return core::Error{"a ring of " + std::to_string(capacity) + " slots exceeds the maximum of " +
                         std::to_string(kMaxCapacity) + " - choose a smaller capacity"};
    const std::size_t slots = std::bit_ceil(std::max<std::size_t>(capacity, 1));
    auto memory = MemoryBlock::in_shared_memory(memory_bytes(slots));
    if (!memory) return memory.error();
    return Ring(std::move(memory).value(), slots);
  }

  /// Maps a ring of another process; checks magic, version, slot size and capacity. The descriptor stays with
  /// the caller. A consumer continues where the previous one stopped.
  static core::Result<Ring> attach(int file_descriptor) {
    auto memory = MemoryBlock::map(file_descriptor);
    if (!memory) return memory.error();
    const std::string where = "file descriptor " + std::to_string(file_descriptor) + ": ";
    if (memory->bytes() < sizeof(RingHeader)) return core::Error{where + "too small for a ring"};
    const auto* header = reinterpret_cast<const RingHeader*>(memory->data());
    if (header->magic != RingHeader::kMagic) return core::Error{where + "not a ring (wrong magic number)"};
    if (header->version != RingHeader::kVersion)
      return core::Error{where + "ring version " + std::to_string(header->version) +
                         ", this program has version " + std::to_string(RingHeader::kVersion) +
                         " - install matching programs"};
    if (header->slot_bytes != sizeof(T))
      return core::Error{where + "slots of " + std::to_string(header->slot_bytes) +
                         " bytes, this program has " + std::to_string(sizeof(T)) +
                         " - install matching programs"};
    const std::uint64_t slots = header->capacity;
    if (!std::has_single_bit(slots) || slots > (memory->bytes() - sizeof(RingHeader)) / sizeof(T))
      return core::Error{where + "capacity " + std::to_string(slots) + " does not fit " +
                         std::to_string(memory->bytes()) + " bytes"};
    return Ring(std::move(memory).value());
  }

  // Producer side.

  /// Contiguous free slots, possibly fewer than requested or none. Valid until the next begin_write() or
  /// commit().
  std::span<T> begin_write(std::size_t max_count) noexcept {
    std::uint64_t used = producer_.written - producer_.cached_consumed;
    if (capacity_ - used < max_count) {
      refresh_consumed();
      used = producer_.written - producer_.cached_consumed;
    }
    const std::size_t offset = producer_.written & (capacity_ - 1);
    producer_.granted = std::min({max_count, capacity_ - used, capacity_ - offset});
    return {slots_ + offset, producer_.granted};
  }

  /// Makes the first `count` slots of the last begin_write() available to the consumer.
  void commit(std::size_t count) noexcept {
    producer_.written += std::min(count, producer_.granted);
    producer_.granted = 0;
    header_->written.store(producer_.written, std::memory_order_release);
    if (producer_.written - producer_.cached_consumed <= producer_.high_water) return;
    refresh_consumed();  // the cached index overestimates the fill level
    const std::uint64_t used = producer_.written - producer_.cached_consumed;
    if (used <= producer_.high_water) return;
    producer_.high_water = used;
    header_->high_water.store(used, std::memory_order_relaxed);
  }

  /// Copies a value into the ring. False, and one more dropped(), if it is full.
  bool try_push(const T& value) noexcept {
    const std::span<T> slot = begin_write(1);
    if (slot.empty()) {
      count_dropped(1);
      return false;
    }
    std::memcpy(static_cast<void*>(slot.data()), &value, sizeof(T));
    commit(1);
    return true;
  }

  /// Counts values that the producer discarded because the ring was full.
  void count_dropped(std::uint64_t count) noexcept {
    producer_.dropped += count;
    header_->dropped.store(producer_.dropped, std::memory_order_relaxed);
  }

  // Consumer side.

  /// Contiguous filled slots, possibly none. Valid until the next begin_read() or consume().
  std::span<const T> begin_read() noexcept {
    std::uint64_t filled = consumer_.cached_written - consumer_.consumed;
    if (filled == 0) {
      consumer_.cached_written = header_->written.load(std::memory_order_acquire);
      filled = consumer_.cached_written - consumer_.consumed;
    }
    if (filled > capacity_) {
      // The index left by a previous consumer is impossible: skip to the newest slot.
      consumer_.consumed = consumer_.cached_written;
      header_->consumed.store(consumer_.consumed, std::memory_order_release);
      filled = 0;
    }
    const std::size_t offset = consumer_.consumed & (capacity_ - 1);
    consumer_.granted = std::min<std::size_t>(filled, capacity_ - offset);
    return {slots_ + offset, consumer_.granted};
  }

  /// Returns the first `count` slots of the last begin_read() to the producer.
  void consume(std::size_t count) noexcept {
    const std::size_t taken = std::min(count, consumer_.granted);
    consumer_.granted -= taken;
    consumer_.consumed += taken;
    header_->consumed.store(consumer_.consumed, std::memory_order_release);
  }

  std::optional<T> try_pop() noexcept {
    const std::span<const T> slots = begin_read();
    if (slots.empty()) return std::nullopt;
    std::optional<T> value(slots.front());
    consume(1);
    return value;
  }

  // Any thread.

  /// Filled slots; capacity() if the consumer's index is impossible.
  [[nodiscard]] std::size_t size() const noexcept {
    const std::uint64_t read = header_->consumed.load(std::memory_order_acquire);
    const std::uint64_t write = header_->written.load(std::memory_order_acquire);
    return std::min<std::uint64_t>(write - read, capacity_);
  }
  [[nodiscard]] std::size_t capacity() const noexcept { return capacity_; }
  [[nodiscard]] std::uint64_t dropped() const noexcept {
    return header_->dropped.load(std::memory_order_relaxed);
  }
  /// Maximum fill level so far.
  [[nodiscard]] std::size_t high_water() const noexcept {
    return header_->high_water.load(std::memory_order_relaxed);
  }
  /// Slots committed and consumed since the creation of the ring.
  [[nodiscard]] std::uint64_t written() const noexcept {
    return header_->written.load(std::memory_order_acquire);
  }
  [[nodiscard]] std::uint64_t consumed() const noexcept {
    return header_->consumed.load(std::memory_order_acquire);
  }
  /// Number of impossible consumer indices seen by the producer.
  [[nodiscard]] std::uint64_t impossible_fills() const noexcept {
    return header_->impossible_fills.load(std::memory_order_relaxed);
  }
  /// memfd to pass to another process; -1 in private memory and in attached rings.
  [[nodiscard]] int file_descriptor() const noexcept { return memory_.file_descriptor(); }

 private:
  static constexpr std::size_t kMaxCapacity = (std::size_t{1} << 40) / std::bit_ceil(sizeof(T));

  // Each side's own index and its cached copy of the other's; the shared header is for the other side.
  struct alignas(kCacheLineBytes) ProducerState {
    std::uint64_t written = 0;
    std::uint64_t cached_consumed = 0;
    std::size_t granted = 0;
    std::uint64_t dropped = 0;
    std::uint64_t high_water = 0;
    std::uint64_t impossible_fills = 0;
  };
  struct alignas(kCacheLineBytes) ConsumerState {
    std::uint64_t consumed = 0;
    std::uint64_t cached_written = 0;
    std::size_t granted = 0;
  };

  static std::size_t memory_bytes(std::size_t slots) { return sizeof(RingHeader) + slots * sizeof(T); }

  Ring(MemoryBlock memory, std::size_t capacity) : memory_(std::move(memory)) {
    header_ = ::new (memory_.data()) RingHeader;
    header_->slot_bytes = sizeof(T);
    header_->capacity = capacity;
    locate_slots();
  }

  explicit Ring(MemoryBlock attached) : memory_(std::move(attached)) {
    header_ = std::launder(reinterpret_cast<RingHeader*>(memory_.data()));
    locate_slots();
    consumer_.consumed = header_->consumed.load(std::memory_order_acquire);
    consumer_.cached_written = header_->written.load(std::memory_order_acquire);
    producer_.written = consumer_.cached_written;
    producer_.dropped = header_->dropped.load(std::memory_order_relaxed);
    producer_.high_water = header_->high_water.load(std::memory_order_relaxed);
    producer_.impossible_fills = header_->impossible_fills.load(std::memory_order_relaxed);
    refresh_consumed();
  }

  void locate_slots() noexcept {
    slots_ = std::launder(reinterpret_cast<T*>(memory_.data() + sizeof(RingHeader)));
    capacity_ = header_->capacity;
  }

  void refresh_consumed() noexcept {
    const std::uint64_t consumed = header_->consumed.load(std::memory_order_acquire);
    if (producer_.written - consumed <= capacity_) {
      producer_.cached_consumed = consumed;
      return;
    }
    producer_.cached_consumed = producer_.written - capacity_;
    header_->impossible_fills.store(++producer_.impossible_fills, std::memory_order_relaxed);
  }

  MemoryBlock memory_;
  RingHeader* header_ = nullptr;
  T* slots_ = nullptr;
  std::size_t capacity_ = 0;
  ProducerState producer_;
  ConsumerState consumer_;
};

}  // namespace nilio::ipc
