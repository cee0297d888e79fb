#pragma once

#include "nilio/drivers/source.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace nilio::drivers {

/// Counter with one writer and any number of readers: no read-modify-write instruction needed.
inline void add_to(std::atomic<std::uint64_t>& counter, std::uint64_t n) {
  counter.store(counter.load(std::memory_order_relaxed) + n, std::memory_order_relaxed);
}

/// SourceStats that one thread counts and others read.
class SourceCounters {
 public:
  void add_delivered(std::uint64_t n) { add_to(delivered_, n); }
  void add_kernel_dropped(std::uint64_t n) { add_to(kernel_dropped_, n); }
  void add_malformed(std::uint64_t n) { add_to(malformed_, n); }
  void add_other(std::uint64_t n) { add_to(other_, n); }

  [[nodiscard]] SourceStats read() const {
    return {.delivered = delivered_.load(std::memory_order_relaxed),
            .kernel_dropped = kernel_dropped_.load(std::memory_order_relaxed),
            .malformed = malformed_.load(std::memory_order_relaxed),
            .other = other_.load(std::memory_order_relaxed)};
  }

 private:
  std::atomic<std::uint64_t> delivered_{0};
  std::atomic<std::uint64_t> kernel_dropped_{0};
  std::atomic<std::uint64_t> malformed_{0};
  std::atomic<std::uint64_t> other_{0};
};

/// Counts by key, for the first `kCapacity` keys; further keys share one count. One thread counts, any thread
/// reads, without locks. count() does not allocate.
template <class Key, std::size_t kCapacity>
class KeyCounter {
 public:
  void count(const Key& key) {
    const std::size_t used = used_.load(std::memory_order_relaxed);
    for (std::size_t i = 0; i < used; ++i) {
      if (entries_[i].key == key) return add_to(entries_[i].count, 1);
    }
    if (used == kCapacity) return add_to(further_, 1);
    entries_[used].key = key;
    add_to(entries_[used].count, 1);
    // Published last: a key never changes once readers see it.
    used_.store(used + 1, std::memory_order_release);
  }

  /// Number of different keys, at most the capacity.
  [[nodiscard]] std::size_t keys() const { return used_.load(std::memory_order_acquire); }

  /// "{text_of(key, count)}, ...", the most frequent first; empty when nothing was counted.
  template <class TextOf>
  [[nodiscard]] std::string describe(const TextOf& text_of) const {
    struct Counted {
      Key key;
      std::uint64_t count;
    };
    std::vector<Counted> sorted;
    const std::size_t used = keys();
    for (std::size_t i = 0; i < used; ++i) {
      sorted.push_back({entries_[i].key, entries_[i].count.load(std::memory_order_relaxed)});
    }
    std::stable_sort(sorted.begin(), sorted.end(),
                     [](const Counted& a, const Counted& b) { return a.count > b.count; });
    std::string text;
    for (const Counted& entry : sorted) text += (text.empty() ? "" : ", ") + text_of(entry.key, entry.count);
    if (const std::uint64_t further = further_.load(std::memory_order_relaxed); further > 0) {
      text += ", and " + std::to_string(further) + " others";
    }
    return text;
  }

 private:
  struct Entry {
    Key key{};
    std::atomic<std::uint64_t> count{0};
  };

  std::array<Entry, kCapacity> entries_{};
  std::atomic<std::size_t> used_{0};
  std::atomic<std::uint64_t> further_{0};
};

}  // namespace nilio::drivers
