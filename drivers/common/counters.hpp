#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace nilio::drivers {

/// Counts by key, for the first `kCapacity` keys seen; the others are counted together. One thread counts
/// while any may read, without locks and, in count(), without allocation.
template <class Key, std::size_t kCapacity>
class KeyCounter {
 public:
  void count(const Key& key) {
    const std::size_t used = used_.load(std::memory_order_relaxed);
    for (std::size_t i = 0; i < used; ++i) {
      if (entries_[i].key == key) return add(entries_[i].count);
    }
    if (used == kCapacity) return add(further_);
    entries_[used].key = key;
    add(entries_[used].count);
    // A key never changes once it can be seen.
    used_.store(used + 1, std::memory_order_release);
  }

  /// Different keys seen, at most the capacity.
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

  static void add(std::atomic<std::uint64_t>& counter) {
    counter.store(counter.load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
  }

  std::array<Entry, kCapacity> entries_{};
  std::atomic<std::size_t> used_{0};
  std::atomic<std::uint64_t> further_{0};
};

}  // namespace nilio::drivers
