#pragma once

#include "nilio/core/result.hpp"

#include "daemon/realtime/thread_plan.hpp"
#include "ipc/pose_record.hpp"

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>

namespace nilio::daemon {

/// Sees to it that a pose leaves for every scan by its deadline: what the odometry thread has not handed over
/// by then, the guard's thread hands over as a prediction, which was left with it before. For each scan just
/// one of the two publishes, and what one has published the other sees: the publisher's ring has one writer
/// at a time.
class DeadlineGuard {
 public:
  using Publish = std::function<void(const ipc::PoseRecord&)>;

  /// `publish` is called in the guard's thread. Fails without a timer, naming why.
  static core::Result<std::unique_ptr<DeadlineGuard>> create(Publish publish);
  ~DeadlineGuard();
  DeadlineGuard(const DeadlineGuard&) = delete;
  DeadlineGuard& operator=(const DeadlineGuard&) = delete;

  /// By the odometry thread: `prediction` is to be published at `publish_ns` (CLOCK_MONOTONIC), unless
  /// claim() comes first; by how much that misses `deadline_ns` is noted in it. After each arm() one claim().
  void arm(const ipc::PoseRecord& prediction, std::int64_t deadline_ns, std::int64_t publish_ns);
  /// True: the odometry thread publishes. False: the guard has, and published() is what.
  [[nodiscard]] bool claim();
  [[nodiscard]] const ipc::PoseRecord& published() const { return prediction_; }

  /// Body of the guard's thread; returns after stop().
  void run(ThreadHook hook = nullptr);
  /// From any thread.
  void stop();

 private:
  enum class State : std::uint8_t { kIdle, kArmed, kPublishing, kPublished };

  DeadlineGuard(int timer, Publish publish) : timer_(timer), publish_(std::move(publish)) {}
  void set_timer(std::int64_t at_ns) const;

  int timer_;
  Publish publish_;
  ipc::PoseRecord prediction_;
  std::int64_t deadline_ns_ = 0;
  std::atomic<std::int64_t> publish_ns_{0};
  std::atomic<State> state_{State::kIdle};
  std::atomic<bool> stop_{false};
};

}  // namespace nilio::daemon
