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
  const int wanted = odometry_->state_->arena.max_concurrency();
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
  odometry_->state_->arena.execute([&] { tbb::parallel_for(0, wanted, come, tbb::simple_partitioner()); });
  return arrived.load();
}

}  // namespace nilio::core
