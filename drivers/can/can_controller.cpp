#include "nilio/drivers/can/can_controller.hpp"

#include "nilio/core/clock.hpp"

#include "drivers/can/can_monitor.hpp"
#include "drivers/can/socketcan/can_interface.hpp"

#include <chrono>
#include <condition_variable>
#include <mutex>
#include <net/if.h>
#include <thread>
#include <utility>

namespace nilio::drivers {

using Clock = std::chrono::steady_clock;

namespace {

constexpr std::chrono::milliseconds kCheckPeriod{100};
/// Much longer than any driver needs or a starved thread waits; lost frames are detected sooner by their
/// source.
constexpr std::chrono::seconds kLongestSilence{10};
constexpr std::chrono::milliseconds kLongestShutdown{300};
/// Number of threads abandoned before giving up.
constexpr unsigned kMostHelpers = 8;
/// Limit of the events that the caller has not taken.
constexpr std::size_t kMostEvents = 64;

}  // namespace

struct CanController::Shared {
  Shared(CanControllerConfig wanted, bool privileged)
      : config(std::move(wanted)), monitor(config, privileged) {}

  const CanControllerConfig config;
  std::mutex mutex;
  std::condition_variable changed;
  CanMonitor monitor;
  std::vector<CanEvent> events;
  /// Number of the current helper thread; results of older, blocked ones are ignored.
  unsigned generation = 0;
  bool running = false;
  bool stop = false;
  Clock::time_point last_activity = Clock::now();
};

core::Result<std::unique_ptr<CanController>> CanController::watch(const CanControllerConfig& config) {
  const std::string& name = config.interface_name;
  if (name.empty() || name.size() >= IFNAMSIZ)
    return core::Error{"CAN " + name +
                       ": is no interface name; write it as 'ip link' shows it, such as can0"};
  const CanInterfaceState seen = query_can_interface(name);
  if (seen.present && !seen.is_can)
    return core::Error{"CAN " + name + ": is no CAN interface; 'ip link show type can' lists them"};
  return std::unique_ptr<CanController>(
      new CanController(std::make_shared<Shared>(config, may_set_up_interfaces())));
}

CanController::CanController(std::shared_ptr<Shared> shared) : shared_(std::move(shared)) {
  const std::lock_guard lock(shared_->mutex);
  start_helper();
}

CanController::~CanController() {
  std::unique_lock lock(shared_->mutex);
  shared_->stop = true;
  shared_->changed.notify_all();
  shared_->changed.wait_for(lock, kLongestShutdown, [this] { return !shared_->running; });
}

/// Requires the lock.
void CanController::start_helper() {
  shared_->running = true;
  shared_->last_activity = Clock::now();
  std::thread(run, shared_, ++shared_->generation).detach();
}

/// Releases the lock during every call into the kernel.
void CanController::run(const std::shared_ptr<Shared>& shared, unsigned generation) {
  using Action = CanMonitor::Action;
  const CanControllerConfig& config = shared->config;
  const auto is_current = [&] { return !shared->stop && shared->generation == generation; };
  CanInterfaceState seen;
  std::unique_lock lock(shared->mutex);
  while (is_current()) {
    lock.unlock();
    seen = read_can_interface(config.interface_name);
    lock.lock();
    if (!is_current()) break;
    shared->last_activity = Clock::now();
    const Action action = shared->monitor.observe(seen, monotonic_ns());
    if (action != Action::kNone) {
      lock.unlock();
      if (action == Action::kSetUp)
        set_up_can_interface(config.interface_name, config.bitrate, config.restart_ms);
      if (action == Action::kRestart) restart_can_controller(config.interface_name, seen.driver);
      seen = read_can_interface(config.interface_name);
      lock.lock();
      if (!is_current()) break;
      shared->last_activity = Clock::now();
      if (action == Action::kSetUp) shared->monitor.set_up_result(seen);
    }
    for (CanEvent& event : shared->monitor.take_events())
      if (shared->events.size() < kMostEvents) shared->events.push_back(std::move(event));
    shared->changed.wait_for(lock, kCheckPeriod, [&] { return !is_current(); });
  }
  if (shared->generation == generation) {
    shared->running = false;
    shared->changed.notify_all();
  }
}

std::vector<CanEvent> CanController::take_events() {
  const std::lock_guard lock(shared_->mutex);
  if (shared_->running && Clock::now() - shared_->last_activity > kLongestSilence) {
    const std::string where = "CAN " + shared_->config.interface_name + ": ";
    if (shared_->generation < kMostHelpers) {
      shared_->events.push_back(
          {true, where + "its driver does not answer; querying it again, check the adapter"});
      start_helper();
    } else {
      shared_->events.push_back(
          {true, where + "its driver still does not answer and is no longer queried; frames are "
                         "received all the same, check the adapter"});
      ++shared_->generation;
      shared_->running = false;
    }
  }
  return std::exchange(shared_->events, {});
}

CanControllerStatus CanController::status() const {
  const std::lock_guard lock(shared_->mutex);
  return shared_->monitor.status();
}

}  // namespace nilio::drivers
