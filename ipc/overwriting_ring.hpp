#pragma once

#include "nilio/core/result.hpp"

#include "ipc/memory_block.hpp"
#include "ipc/ring.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <new>
#include <string>
#include <type_traits>
#include <utility>

namespace nilio::ipc {

/// Ring in shared memory whose producer never waits and never fails: it overwrites the oldest value, so that
/// the newest wins. For large values that a slow or dead consumer may miss. Every slot is a sequence lock of
/// atomic words, so the consumer detects a value that changes while it is copied, and counts it as dropped. A
/// consumer that replaces a killed one continues where that one stopped.
///
/// One thread produces, one thread consumes; the counters and flags may be used by any thread.
template <class T>
class OverwritingRing {
  static_assert(std::is_trivially_copyable_v<T> && sizeof(T) % sizeof(std::uint64_t) == 0);

 public:
  /// Creates the ring. The capacity is rounded up to a power of two, at least 2; one slot fewer is readable,
  /// because the producer may be writing one. The descriptor is close-on-exec.
  static core::Result<OverwritingRing> in_shared_memory(std::size_t capacity) {
    const std::size_t slots = std::bit_ceil(std::max<std::size_t>(capacity, 2));
    auto memory = MemoryBlock::in_shared_memory(sizeof(Header) + slots * sizeof(Slot));
    if (!memory) return memory.error();
    auto* const header = ::new (memory->data()) Header;
    header->slot_bytes = sizeof(Slot);
    header->capacity = slots;
    return OverwritingRing(std::move(memory).value());
  }

  /// Maps a ring of another process; checks magic, slot size and capacity. The descriptor stays with the
  /// caller. read() continues where the previous consumer stopped.
  static core::Result<OverwritingRing> attach(int file_descriptor) {
    auto memory = MemoryBlock::map(file_descriptor);
    if (!memory) return memory.error();
    const auto* header = reinterpret_cast<const Header*>(memory->data());
    const bool fits = memory->bytes() >= sizeof(Header) && header->magic == kMagic &&
                      header->slot_bytes == sizeof(Slot) && std::has_single_bit(header->capacity) &&
                      header->capacity == (memory->bytes() - sizeof(Header)) / sizeof(Slot);
    if (!fits)
      return core::Error{"file descriptor " + std::to_string(file_descriptor) +
                         ": not the overwriting ring of this program - install matching programs"};
    return OverwritingRing(std::move(memory).value());
  }

  // Producer side.

  /// Writes the first `bytes` of a value.
  void push(const T& value, std::size_t bytes = sizeof(T)) noexcept {
    const std::uint64_t number = written_;
    Slot& slot = slots_[number & (capacity_ - 1)];
    slot.version.store(2 * number + 1, std::memory_order_relaxed);
    const std::size_t words = (std::min(bytes, sizeof(T)) + kWord - 1) / kWord;
    const auto* source = reinterpret_cast<const std::byte*>(&value);
    // A reader that sees one of the words sees the odd version, too.
    for (std::size_t i = 0; i < words; ++i) {
      std::uint64_t word = 0;
      std::memcpy(&word, source + i * kWord, kWord);
      slot.words[i].store(word, std::memory_order_release);
    }
    slot.used.store(words, std::memory_order_release);
    slot.version.store(2 * number + 2, std::memory_order_release);
    header_->written.store(++written_, std::memory_order_release);
  }

  /// False while another push() would overwrite a value that the consumer has not read.
  [[nodiscard]] bool has_room() const noexcept {
    return written_ - header_->taken.load(std::memory_order_acquire) < capacity_ - 1;
  }

  // Consumer side.

  /// Reads the oldest value that is still there. False if there is none.
  bool read(T& value) noexcept {
    while (true) {
      const std::uint64_t written = header_->written.load(std::memory_order_acquire);
      if (next_ >= written) {
        next_ = written;
        return false;
      }
      if (const std::uint64_t oldest = oldest_of(written); next_ < oldest) count_dropped(oldest - next_);
      if (copy(value)) {
        header_->taken.store(++next_, std::memory_order_release);
        return true;
      }
      count_dropped(1);
    }
  }

  /// Reads the newest value and counts those before it as dropped.
  bool read_newest(T& value) noexcept {
    const std::uint64_t written = header_->written.load(std::memory_order_acquire);
    if (next_ + 1 < written) count_dropped(written - 1 - next_);
    return read(value);
  }

  /// Returns to the oldest value that is still there, read or not.
  void rewind() noexcept { next_ = oldest_of(header_->written.load(std::memory_order_acquire)); }
  /// Skips all values without counting them.
  void skip_all() noexcept {
    next_ = header_->written.load(std::memory_order_acquire);
    header_->taken.store(next_, std::memory_order_release);
  }

  // Any thread.

  /// Whether the consumer uses values at present; the producer may spare their making otherwise.
  void set_wanted(bool wanted) noexcept { header_->wanted.store(wanted ? 1 : 0, std::memory_order_relaxed); }
  [[nodiscard]] bool wanted() const noexcept { return header_->wanted.load(std::memory_order_relaxed) != 0; }
  [[nodiscard]] std::size_t capacity() const noexcept { return capacity_; }
  [[nodiscard]] std::uint64_t written() const noexcept {
    return header_->written.load(std::memory_order_acquire);
  }
  /// Number of the next value to read.
  [[nodiscard]] std::uint64_t taken() const noexcept {
    return header_->taken.load(std::memory_order_acquire);
  }
  /// Values that were overwritten before the consumer had read them.
  [[nodiscard]] std::uint64_t dropped() const noexcept {
    return header_->dropped.load(std::memory_order_relaxed);
  }
  /// -1 in attached rings.
  [[nodiscard]] int file_descriptor() const noexcept { return memory_.file_descriptor(); }

 private:
  static constexpr std::uint64_t kMagic = 0x5256'4F4F'494C'494E;  // "NILIOOVR", little endian
  static constexpr std::size_t kWord = sizeof(std::uint64_t);

  // Each side writes only its own cache line.
  struct Header {
    std::uint64_t magic = kMagic;
    std::uint64_t slot_bytes = 0;
    std::uint64_t capacity = 0;
    alignas(kCacheLineBytes) std::atomic<std::uint64_t> written{0};
    alignas(kCacheLineBytes) std::atomic<std::uint64_t> taken{0};
    std::atomic<std::uint64_t> dropped{0};
    std::atomic<std::uint32_t> wanted{0};
  };
  struct Slot {
    /// 2 n + 1 while value n is being written, 2 n + 2 afterwards.
    std::atomic<std::uint64_t> version{0};
    std::atomic<std::uint64_t> used{0};
    std::array<std::atomic<std::uint64_t>, sizeof(T) / kWord> words;
  };

  explicit OverwritingRing(MemoryBlock memory)
      : memory_(std::move(memory)),
        header_(std::launder(reinterpret_cast<Header*>(memory_.data()))),
        slots_(std::launder(reinterpret_cast<Slot*>(memory_.data() + sizeof(Header)))),
        capacity_(header_->capacity),
        written_(header_->written.load(std::memory_order_acquire)),
        next_(std::min(header_->taken.load(std::memory_order_acquire), written_)) {}

  [[nodiscard]] std::uint64_t oldest_of(std::uint64_t written) const noexcept {
    return written - std::min<std::uint64_t>(written, capacity_ - 1);
  }

  void count_dropped(std::uint64_t count) noexcept {
    next_ += count;
    header_->taken.store(next_, std::memory_order_release);
    header_->dropped.fetch_add(count, std::memory_order_relaxed);
  }

  bool copy(T& value) const noexcept {
    const Slot& slot = slots_[next_ & (capacity_ - 1)];
    const std::uint64_t wanted_version = 2 * next_ + 2;
    if (slot.version.load(std::memory_order_acquire) != wanted_version) return false;
    const std::uint64_t words =
        std::min<std::uint64_t>(slot.used.load(std::memory_order_acquire), sizeof(T) / kWord);
    auto* const target = reinterpret_cast<std::byte*>(&value);
    for (std::uint64_t i = 0; i < words; ++i) {
      const std::uint64_t word = slot.words[i].load(std::memory_order_acquire);
      std::memcpy(target + i * kWord, &word, kWord);
    }
    return slot.version.load(std::memory_order_relaxed) == wanted_version;
  }

  MemoryBlock memory_;
  Header* header_;
  Slot* slots_;
  std::size_t capacity_;
  std::uint64_t written_;  ///< of the producer
  std::uint64_t next_;     ///< of the consumer
};

}  // namespace nilio::ipc
