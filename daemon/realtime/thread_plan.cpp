#include "daemon/realtime/thread_plan.hpp"

#include "ipc/kernel_requests.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <fstream>
#include <functional>
#include <optional>
#include <pthread.h>
#include <sched.h>
#include <system_error>
#include <utility>

namespace nilio::daemon {

namespace {

using core::Error;
using core::Result;

// A quarter of the stack: matrices on it have fixed sizes, large buffers are on the heap.
constexpr std::size_t kTouchedStackBytes = std::size_t{256} << 10U;
constexpr std::size_t kPageBytes = 4096;

const char* key_of(ThreadRole role) {
  switch (role) {
    case ThreadRole::kLidarReceive:
      return "realtime.lidar_cpus";
    case ThreadRole::kImuReceive:
      return "realtime.imu_cpus";
    case ThreadRole::kDeadlineGuard:
    case ThreadRole::kOdometry:
      return "realtime.odometry_cpus";
  }
  return "realtime";
}

std::string policy_text(int policy, int priority) {
  if (policy == SCHED_FIFO) return "FIFO " + std::to_string(priority);
  if (policy == SCHED_RR) return "RR " + std::to_string(priority);
  return "normal scheduling";
}

std::string processors_text(const CpuList& cpus) {
  return (cpus.size() == 1 ? "CPU " : "CPUs ") + cpu_list_text(cpus);
}

std::string scheduling_text(const ThreadScheduling& scheduling) {
  return policy_text(scheduling.policy, scheduling.priority) + " on " + processors_text(scheduling.cpus);
}

cpu_set_t to_set(const CpuList& cpus) {
  cpu_set_t set;
  CPU_ZERO(&set);
  for (const int cpu : cpus) CPU_SET(static_cast<std::size_t>(cpu), &set);
  return set;
}

/// Empty if granted, otherwise the refusal and its remedy.
std::string request_processors(const CpuList& cpus, ThreadRole role) {
  const cpu_set_t set = to_set(cpus);
  if (sched_setaffinity(0, sizeof set, &set) != 0) {
    return processors_text(cpus) + " refused (" + std::strerror(errno) + "): correct " + key_of(role) +
           ", or allow them for the container";
  }
  // The kernel silently ignores CPUs that do not exist.
  const CpuList obtained = scheduling_of(0).cpus;
  if (obtained == cpus) return {};
  return processors_text(cpus) + " not all available, only " + cpu_list_text(obtained) + ": correct " +
         key_of(role) + ", or allow them for the container";
}

std::optional<long> read_number(const char* path) {
  std::ifstream file(path);
  long number = 0;
  if (file >> number) return number;
  return std::nullopt;
}

std::optional<int> parse_number(std::string_view text) {
  int number = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (error != std::errc{} || end != text.data() + text.size() || number < 0) return std::nullopt;
  return number;
}

Error invalid_item(std::string_view item, const std::string& what) {
  return Error{"'" + std::string(item) + "' " + what + ": expected numbers and ranges, such as 0 or 1-2,4"};
}

}  // namespace

Result<CpuList> parse_cpu_list(std::string_view text) {
  CpuList cpus;
  while (!text.empty()) {
    const std::string_view item = text.substr(0, text.find(','));
    const auto dash = item.find('-');
    const std::optional<int> first = parse_number(item.substr(0, dash));
    const std::optional<int> last =
        dash == std::string_view::npos ? first : parse_number(item.substr(dash + 1));
    if (!first || !last) return invalid_item(item, "is not a CPU");
    if (*last < *first) return invalid_item(item, "ends before its start");
    if (*last >= CPU_SETSIZE) return invalid_item(item, "is beyond " + std::to_string(CPU_SETSIZE - 1));
    for (int cpu = *first; cpu <= *last; ++cpu) cpus.push_back(cpu);
    if (item.size() + 1 == text.size()) return invalid_item(text, "ends with a comma");
    text.remove_prefix(std::min(text.size(), item.size() + 1));
  }
  std::sort(cpus.begin(), cpus.end());
  cpus.erase(std::unique(cpus.begin(), cpus.end()), cpus.end());
  return cpus;
}

std::string cpu_list_text(const CpuList& cpus) {
  std::string text;
  for (std::size_t i = 0; i < cpus.size();) {
    std::size_t last = i;
    while (last + 1 < cpus.size() && cpus[last + 1] == cpus[last] + 1) ++last;
    text += (text.empty() ? "" : ",") + std::to_string(cpus[i]);
    if (last > i) text += "-" + std::to_string(cpus[last]);
    i = last + 1;
  }
  return text;
}

Result<ThreadPlan> make_thread_plan(const Config& config, RunRules rules) {
  const RealtimeSection& section = config.realtime;
  ThreadPlan plan;
  plan.fifo = section.policy == "fifo" || (section.policy == "auto" && rules.are_live());
  plan.lock_memory = section.lock_memory && rules.are_live();
  plan.strict = section.strict;
  plan.odometry_threads = config.odometry.threads;
  // The guard must preempt a late registration.
  const int guard_priority = std::min(section.odometry_priority + 1, sched_get_priority_max(SCHED_FIFO));
  const std::array<int, kThreadRoles> priorities{section.lidar_priority, section.imu_priority, guard_priority,
                                                 section.odometry_priority};
  const std::array<const std::string*, kThreadRoles> lists{&section.lidar_cpus, &section.imu_cpus,
                                                           &section.odometry_cpus, &section.odometry_cpus};
  for (std::size_t i = 0; i < kThreadRoles; ++i) {
    Result<CpuList> cpus = parse_cpu_list(*lists[i]);
    if (!cpus) return Error{std::string(key_of(static_cast<ThreadRole>(i))) + ": " + cpus.error().message};
    plan.roles[i] = {priorities[i], std::move(cpus).value()};
  }
  return plan;
}

ThreadScheduling scheduling_of(pid_t thread) {
  ThreadScheduling scheduling;
  // The kernel may set a flag in addition to the policy.
  scheduling.policy = sched_getscheduler(thread) & ~SCHED_RESET_ON_FORK;
  sched_param parameters{};
  if (sched_getparam(thread, &parameters) == 0) scheduling.priority = parameters.sched_priority;
  cpu_set_t set;
  CPU_ZERO(&set);
  if (sched_getaffinity(thread, sizeof set, &set) != 0) return scheduling;
  for (int cpu = 0; cpu < CPU_SETSIZE; ++cpu) {
    if (CPU_ISSET(static_cast<std::size_t>(cpu), &set)) scheduling.cpus.push_back(cpu);
  }
  return scheduling;
}

void run_as(const ThreadScheduling& scheduling) {
  const sched_param parameters{scheduling.priority};
  sched_setscheduler(0, scheduling.policy, &parameters);
  const cpu_set_t set = to_set(scheduling.cpus);
  sched_setaffinity(0, sizeof set, &set);
}

void touch_stack() {
  // Volatile writes: the compiler must not remove them.
  std::array<unsigned char, kTouchedStackBytes> stack;
  volatile unsigned char* const bytes = stack.data();
  for (std::size_t i = 0; i < stack.size(); i += kPageBytes) bytes[i] = 0;
}

PlanOutcome apply_to_this_thread(const ThreadPlan& plan, ThreadRole role) {
  const std::string name = name_of(role);
  const ThreadPlan::Role& wanted = plan.of(role);
  pthread_setname_np(pthread_self(), name.c_str());
  std::string refused;
  if (plan.fifo) refused = ipc::request_fifo(wanted.priority);
  if (!wanted.cpus.empty()) {
    const std::string cpus = request_processors(wanted.cpus, role);
    refused += (refused.empty() || cpus.empty() ? "" : "; ") + cpus;
  }
  touch_stack();
  const std::string has = scheduling_text(scheduling_of(0));
  if (refused.empty()) return {true, name + ": " + has};
  return {false, name + ": " + refused + "; it has " + has};
}

PlanOutcome check_workers(const ThreadPlan& plan, const std::vector<pid_t>& workers) {
  const ThreadScheduling own = scheduling_of(0);
  const std::string name = name_of(ThreadRole::kOdometry);
  for (const pid_t worker : workers) {
    const ThreadScheduling scheduling = scheduling_of(worker);
    if (scheduling == own) continue;
    return {false, name + ": its worker " + std::to_string(worker) + " has " + scheduling_text(scheduling) +
                       " instead of " + scheduling_text(own) +
                       " - do not change the scheduling of its threads externally"};
  }
  const int missing = plan.odometry_threads - 1 - static_cast<int>(workers.size());
  if (missing > 0) {
    return {true,
            name + ": " + std::to_string(missing) + " of its " + std::to_string(plan.odometry_threads) +
                " threads did not start: too few CPUs - lower odometry.threads",
            true};
  }
  return {true, name + ": " + std::to_string(workers.size()) +
                    (workers.size() == 1 ? " worker with the same scheduling"
                                         : " workers with the same scheduling")};
}

PlanOutcome check_throttling(const ThreadPlan& plan) {
  if (!plan.fifo) return {true, "supervisor: no FIFO threads"};
  const std::optional<long> runtime_us = read_number("/proc/sys/kernel/sched_rt_runtime_us");
  const std::optional<long> period_us = read_number("/proc/sys/kernel/sched_rt_period_us");
  std::string throttling = "throttling of FIFO threads is unknown";
  if (runtime_us && *runtime_us < 0) {
    throttling = "FIFO threads are not throttled (sched_rt_runtime_us is -1)";
  } else if (runtime_us && period_us) {
    throttling = "FIFO threads get at most " + std::to_string(*runtime_us / 1000) + " of every " +
                 std::to_string(*period_us / 1000) + " ms (sched_rt_runtime_us)";
  }
  const CpuList own = scheduling_of(0).cpus;
  const CpuList& odometry = plan.of(ThreadRole::kOdometry).cpus;
  const bool covers_all =
      odometry.empty() || std::includes(odometry.begin(), odometry.end(), own.begin(), own.end());
  if (!covers_all || static_cast<std::size_t>(plan.odometry_threads) < own.size())
    return {true, "supervisor: has a CPU not used by the odometry; " + throttling};
  return {true,
          "supervisor: the odometry's " + std::to_string(plan.odometry_threads) + " threads may use all of " +
              processors_text(own) + "; log, files and supervision then wait; " + throttling +
              " - exclude a CPU from realtime.odometry_cpus, or lower odometry.threads",
          true};
}

PlanThread::PlanThread(std::function<void()> body)
    : body_(std::make_unique<std::function<void()>>(std::move(body))) {
  pthread_attr_t attributes;
  pthread_attr_init(&attributes);
  pthread_attr_setstacksize(&attributes, ipc::kThreadStackBytes);
  const auto run = [](void* data) -> void* {
    (*static_cast<std::function<void()>*>(data))();
    return nullptr;
  };
  const int error = pthread_create(&thread_, &attributes, run, body_.get());
  pthread_attr_destroy(&attributes);
  if (error != 0) throw std::system_error(error, std::generic_category(), "cannot start a thread");
}

void PlanThread::join() { pthread_join(thread_, nullptr); }

}  // namespace nilio::daemon
