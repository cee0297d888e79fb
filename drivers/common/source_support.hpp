#pragma once

#include "nilio/core/time.hpp"
#include "nilio/drivers/source.hpp"

#include <atomic>
#include <cstdint>
#include <ctime>

namespace nilio::drivers {

/// SourceStats that one thread counts and others read.
class SourceCounters {
 public:
  void add_delivered(std::uint64_t n) { add(delivered_, n); }
  void add_kernel_dropped(std::uint64_t n) { add(kernel_dropped_, n); }
  void add_malformed(std::uint64_t n) { add(malformed_, n); }
  void add_other(std::uint64_t n) { add(other_, n); }

  [[nodiscard]] SourceStats read() const {
    return {.delivered = delivered_.load(std::memory_order_relaxed),
            .kernel_dropped = kernel_dropped_.load(std::memory_order_relaxed),
            .malformed = malformed_.load(std::memory_order_relaxed),
            .other = other_.load(std::memory_order_relaxed)};
  }

 private:
  /// One writer: no read-modify-write instruction needed.
  static void add(std::atomic<std::uint64_t>& counter, std::uint64_t n) {
    counter.store(counter.load(std::memory_order_relaxed) + n, std::memory_order_relaxed);
  }

  std::atomic<std::uint64_t> delivered_{0};
  std::atomic<std::uint64_t> kernel_dropped_{0};
  std::atomic<std::uint64_t> malformed_{0};
  std::atomic<std::uint64_t> other_{0};
};

inline std::int64_t clock_ns(clockid_t clock) {
  timespec now{};
  clock_gettime(clock, &now);
  return static_cast<std::int64_t>(now.tv_sec) * 1'000'000'000 + now.tv_nsec;
}

}  // namespace nilio::drivers
