#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/time.hpp"

#include "ipc/records.hpp"

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>

namespace nilio::daemon {

/// Publishes a predicted pose at the deadline if the odometry thread is late, so that every scan gets a pose.
/// The odometry thread deposits the prediction before it registers. Exactly one of the two threads publishes
/// each scan, and each sees the other's result; the publisher's ring therefore has one writer at a time.
class DeadlineGuard {
 public:
  using Publish = std::function<void(const ipc::PoseRecord&)>;

  /// `publish` is called in the guard's thread. Fails if no timer is available; the error states why.
  static core::Result<std::unique_ptr<DeadlineGuard>> create(Publish publish);
  ~DeadlineGuard();
  DeadlineGuard(const DeadlineGuard&) = delete;
  DeadlineGuard& operator=(const DeadlineGuard&) = delete;

  /// Odometry thread: publishes `prediction` at `publish_ns` (CLOCK_MONOTONIC) unless claim() comes first,
  /// and records its overshoot past `deadline_ns`. Call claim() once after each arm().
  void arm(const ipc::PoseRecord& prediction, std::int64_t deadline_ns, std::int64_t publish_ns);
  /// True: the odometry thread publishes. False: the guard has published published().
  [[nodiscard]] bool claim();
  [[nodiscard]] const ipc::PoseRecord& published() const { return prediction_; }

  /// One round of the guard's thread: waits for a deadline, at most kLongestWait; false after stop().
  bool run();
  /// Any thread.
  void stop();

 private:
  static constexpr core::Duration kLongestWait = core::Duration::from_milliseconds(200.0);
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
