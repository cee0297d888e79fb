#pragma once

#include "daemon/realtime/thread_hook.hpp"
#include "daemon/realtime/thread_plan.hpp"

#include <atomic>
#include <cstdint>
#include <functional>
#include <future>
#include <memory>
#include <optional>
#include <vector>

namespace nilio::daemon {

/// Work of a real-time thread. Unset parts are skipped.
struct RealtimeWork {
  /// With the thread's scheduling, before its start is complete: allocates and touches memory.
  std::function<std::vector<PlanOutcome>()> prepare{};
  /// One round, which waits for at most about 50 ms; false ends the thread.
  std::function<bool()> run{};
  /// After the last round.
  std::function<void()> finish{};
};

/// Thread with the scheduling of its role, a heartbeat per round, and the phases reported to a hook. Start
/// and join from one thread; heartbeat() from any.
class RealtimeThread {
 public:
  /// Starts the thread. Throws std::system_error if none can be started.
  RealtimeThread(const ThreadPlan& plan, ThreadRole role, ThreadHook hook, RealtimeWork work);

  /// Waits until the thread is prepared; its scheduling and the outcomes of the preparation. In strict mode a
  /// thread whose scheduling is refused ends without a round. Call once.
  std::vector<PlanOutcome> await_start() { return started_.get(); }
  void join() { thread_->join(); }
  [[nodiscard]] ThreadRole role() const { return role_; }
  /// Rounds so far; empty while the thread does not run.
  [[nodiscard]] std::optional<std::uint64_t> heartbeat() const;

 private:
  /// Shared with the thread, so that this object can be moved.
  struct State {
    std::atomic<std::uint64_t> rounds{0};
    std::atomic<bool> running{false};
    std::promise<std::vector<PlanOutcome>> started;
  };

  ThreadRole role_;
  std::shared_ptr<State> state_ = std::make_shared<State>();
  std::future<std::vector<PlanOutcome>> started_;
  std::unique_ptr<PlanThread> thread_;
};

}  // namespace nilio::daemon
