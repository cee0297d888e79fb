#include "tools/bench/realtime/stress_load.hpp"

#include "tools/bench/common/memory_use.hpp"

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <fcntl.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>
#include <utility>

namespace nilio::tools::bench {

namespace {

using core::Error;
using core::Result;

constexpr std::uint64_t kPage = 4096;
constexpr int kMostUrgent = -20;

/// The children must not take locks: a thread of the parent may have held one during fork().
[[noreturn]] void burn() {
  volatile std::uint64_t count = 0;
  for (;;) count = count + 1;
}

[[noreturn]] void take_memory(std::uint64_t bytes) {
  const int adjustment = open("/proc/self/oom_score_adj", O_WRONLY | O_CLOEXEC);
  if (adjustment >= 0) {
    [[maybe_unused]] const ssize_t written = write(adjustment, "1000", 4);
    close(adjustment);
  }
  for (;;) {
    void* const memory = mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (memory == MAP_FAILED) _exit(1);
    auto* const pages = static_cast<volatile std::uint8_t*>(memory);
    for (std::uint64_t at = 0; at < bytes; at += kPage) pages[at] = 1;
    munmap(memory, bytes);
  }
}

template <class Work>
Result<pid_t> spawn(Work work) {
  const pid_t parent = getpid();
  const pid_t pid = fork();
  if (pid < 0) return Error{std::string("a load process cannot be started: ") + std::strerror(errno)};
  if (pid > 0) return pid;
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (getppid() != parent) _exit(1);
  // Signals of the terminal are left to the parent.
  setpgid(0, 0);
  work();
  _exit(1);
}

}  // namespace

Result<StressLoad> StressLoad::cpu_load(unsigned count) {
  StressLoad load;
  for (unsigned i = 0; i < count; ++i) {
    const Result<pid_t> pid = spawn(burn);
    if (!pid) return pid.error();
    load.processes_.push_back(*pid);
  }
  return load;
}

Result<StressLoad> StressLoad::urgent_cpu_load(unsigned count) {
  Result<StressLoad> load = cpu_load(count);
  if (!load) return load;
  for (const pid_t pid : load->processes_) {
    if (setpriority(PRIO_PROCESS, static_cast<id_t>(pid), kMostUrgent) != 0)
      return Error{std::string("nice -20 is not permitted (") + std::strerror(errno) +
                   ") - it takes CAP_SYS_NICE"};
  }
  return load;
}

Result<StressLoad> StressLoad::memory_pressure(std::uint64_t bytes) {
  StressLoad load;
  const Result<pid_t> pid = spawn([bytes] { take_memory(bytes); });
  if (!pid) return pid.error();
  load.processes_.push_back(*pid);
  return load;
}

StressLoad::StressLoad(StressLoad&& other) noexcept : processes_(std::exchange(other.processes_, {})) {}

StressLoad::~StressLoad() {
  for (const pid_t pid : processes_) {
    kill(pid, SIGKILL);
    waitpid(pid, nullptr, 0);
  }
}

bool StressLoad::is_running() const {
  return std::all_of(processes_.begin(), processes_.end(), [](pid_t pid) {
    siginfo_t ended{};
    return waitid(P_PID, static_cast<id_t>(pid), &ended, WEXITED | WNOHANG | WNOWAIT) == 0 &&
           ended.si_pid == 0;
  });
}

std::uint64_t pressure_bytes(std::uint64_t maximum) {
  const std::uint64_t wanted = std::min(maximum, available_memory() / 10 * 9);
  return wanted / kPage * kPage;
}

}  // namespace nilio::tools::bench
