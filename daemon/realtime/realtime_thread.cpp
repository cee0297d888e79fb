#include "daemon/realtime/realtime_thread.hpp"

#include <utility>

namespace nilio::daemon {

RealtimeThread::RealtimeThread(const ThreadPlan& plan, ThreadRole role, ThreadHook hook, RealtimeWork work)
    : role_(role), started_(state_->started.get_future()) {
  const auto report = [role, hook](ThreadPhase phase) {
    if (hook != nullptr) hook(role, phase);
  };
  thread_ = std::make_unique<PlanThread>([&plan, role, report, state = state_, work = std::move(work)] {
    std::vector<PlanOutcome> outcomes{apply_to_this_thread(plan, role)};
    report(ThreadPhase::kStarted);
    const bool runs = outcomes.front().granted || !plan.strict;
    if (runs && work.prepare) {
      for (PlanOutcome& outcome : work.prepare()) outcomes.push_back(std::move(outcome));
    }
    state->started.set_value(std::move(outcomes));
    if (!runs) return;
    state->running.store(true, std::memory_order_relaxed);
    report(ThreadPhase::kSteady);
    while (work.run()) state->rounds.fetch_add(1, std::memory_order_relaxed);
    state->running.store(false, std::memory_order_relaxed);
    report(ThreadPhase::kEnding);
    if (work.finish) work.finish();
  });
}

std::optional<std::uint64_t> RealtimeThread::heartbeat() const {
  if (!state_->running.load(std::memory_order_relaxed)) return std::nullopt;
  return state_->rounds.load(std::memory_order_relaxed);
}

}  // namespace nilio::daemon
