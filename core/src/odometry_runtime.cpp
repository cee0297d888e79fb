#include "nilio/core/odometry_runtime.hpp"

#include "core/src/odometry_impl.hpp"

#include <atomic>
#include <chrono>
#include <thread>

#include <tbb/parallel_for.h>
#include <tbb/partitioner.h>

namespace nilio::core {

namespace {

constexpr std::chrono::microseconds kPoll{100};
constexpr int kPolls = 10'000;

}  // namespace

int OdometryRuntime::warm_up(const std::function<void()>& on_thread) {
  const int wanted = odometry_->state_->threads.all.max_concurrency();
  std::atomic<int> arrived{0};
  std::atomic<bool> over{false};
  // Each arriving thread waits for all others, so that every thread takes exactly one call.
  const auto come = [&](int /*index*/) {
    if (over.load()) return;
    on_thread();
    arrived.fetch_add(1);
    for (int i = 0; i < kPolls && arrived.load() < wanted && !over.load(); ++i)
      std::this_thread::sleep_for(kPoll);
    over.store(true);
  };
  odometry_->state_->threads.all.execute(
      [&] { tbb::parallel_for(0, wanted, come, tbb::simple_partitioner()); });
  return arrived.load();
}

std::optional<Time> OdometryRuntime::latest_imu() const { return odometry_->state_->motion.imu().latest(); }

OdometryResult OdometryRuntime::register_scan(const Scan& scan, const BudgetDecisions& decisions) {
  Odometry::State& s = *odometry_->state_;
  s.update_map();
  s.budget.begin_scan(decisions, s.motion.is_initialising());
  return odometry_->register_within_budget(scan);
}

const ComputeBudget& OdometryRuntime::budget() const { return odometry_->state_->budget; }

void OdometryRuntime::note_published(const OdometryResult& result) {
  odometry_->state_->budget.finish_scan(result.fine_iterations);
}

OdometryResult OdometryRuntime::predict_pose(const Scan& scan) const {
  const Odometry::State& s = *odometry_->state_;
  OdometryResult result = Odometry::State::result_for(scan);
  const MotionPrior prior = s.motion.prior_for(scan);
  MotionFilter filter = s.motion.filter();
  filter.move_clock(scan.clock_step);
  filter.propagate(prior.inputs, prior.span.middle());
  const SweepMotion moved(prior.span, filter.state(), prior.inputs);
  result.imu_used = prior.inputs.gyro;
  const bool has_begun = s.motion.scans() > 0;
  const SE3 T_map_base = has_begun ? filter.state().T_map_base * moved.T_middle_end() : s.motion.T_map_base();
  result.predicted = true;
  result.degradation_level = DegradationLevel::kPredictionOnly;
  result.stop_reason = StopReason::kBudget;
  result.state = s.gate.state_without_registration(s.motion, filter, 1);
  s.describe(prior, filter, moved, T_map_base, result);
  return result;
}

}  // namespace nilio::core
