#pragma once

#include "nilio/core/time.hpp"

#include "ipc/histogram.hpp"
#include "ipc/records.hpp"

#include <atomic>
#include <cstdint>

#include <nlohmann/json_fwd.hpp>

namespace nilio::ipc {

/// Counters of nilio-publisher's scan pose thread, in shared memory: niliod reports them, and a restarted
/// publisher continues them. One thread records, any thread reads.
class PublisherState {
 public:
  /// Call at least every 100 ms.
  void beat() noexcept { heartbeat_.store(heartbeat() + 1, std::memory_order_relaxed); }
  /// Records a scan pose that this thread took from its ring at `taken` and that DDS has written. Late: after
  /// its deadline, initialisation excluded. A pose that DDS refused only counts as failed.
  void record(const PoseRecord& record, core::Time taken, core::Time written, bool accepted) noexcept;

  [[nodiscard]] std::uint64_t heartbeat() const { return heartbeat_.load(std::memory_order_relaxed); }
  [[nodiscard]] std::uint64_t poses() const { return poses_.load(std::memory_order_relaxed); }
  [[nodiscard]] std::uint64_t late_poses() const { return late_.load(std::memory_order_relaxed); }
  [[nodiscard]] std::uint64_t failed_writes() const { return failed_.load(std::memory_order_relaxed); }
  /// Last packet of the scan to the return of write(), corrected for coordinated omission.
  [[nodiscard]] const Histogram& received_to_written() const { return received_to_written_; }
  /// Duration of write().
  [[nodiscard]] const Histogram& write() const { return write_; }
  /// Time of writing minus deadline; early poses count as 0.
  [[nodiscard]] const Histogram& overshoot() const { return overshoot_; }

 private:
  std::atomic<std::uint64_t> heartbeat_{0};
  std::atomic<std::uint64_t> poses_{0};
  std::atomic<std::uint64_t> late_{0};
  std::atomic<std::uint64_t> failed_{0};
  Histogram received_to_written_;
  Histogram write_;
  Histogram overshoot_;
};

/// {"poses", "late_poses", "failed_writes", "received_to_written": {...}, "write": {...}, "overshoot":
/// {...}}; rows as in latency_json().
nlohmann::json publisher_json(const PublisherState& state);

}  // namespace nilio::ipc
