#include "ipc/publisher_state.hpp"

#include <nlohmann/json.hpp>

namespace nilio::ipc {
namespace {

// Only one thread records.
void increment(std::atomic<std::uint64_t>& counter) noexcept {
  counter.store(counter.load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
}

}  // namespace

void PublisherState::record(const PoseRecord& record, core::Time taken, core::Time written,
                            bool accepted) noexcept {
  increment(accepted ? poses_ : failed_);
  if (!accepted) return;
  write_.record((written - taken).ns);
  if (const std::int64_t received = record.stage_time_ns(Stage::kReceived); received != 0)
    received_to_written_.record_corrected(written.ns - received, record.stamp_ns - record.scan_start_ns);
  const std::int64_t delivered = record.stage_time_ns(Stage::kDelivered);
  if (!record.has_deadline || delivered == 0 || record.state == TrackingState::kInitialising) return;
  const std::int64_t overshoot = record.overshoot_ns + written.ns - delivered;
  if (overshoot > 0) increment(late_);
  overshoot_.record(overshoot);
}

nlohmann::json publisher_json(const PublisherState& state) {
  nlohmann::json json =
      latency_json({summarize("received_to_written", state.received_to_written()),
                    summarize("write", state.write()), summarize("overshoot", state.overshoot())});
  json["poses"] = state.poses();
  json["late_poses"] = state.late_poses();
  json["failed_writes"] = state.failed_writes();
  return json;
}

}  // namespace nilio::ipc
