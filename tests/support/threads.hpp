#pragma once

#include <filesystem>
#include <fstream>
#include <sched.h>
#include <string>
#include <sys/types.h>
#include <vector>

namespace nilio::tests {

/// True if this computer grants the test FIFO scheduling.
inline bool may_have_fifo() {
  const sched_param fifo{10};
  const sched_param normal{0};
  if (sched_setscheduler(0, SCHED_FIFO, &fifo) != 0) return false;
  sched_setscheduler(0, SCHED_OTHER, &normal);
  return true;
}

/// Threads with this name in a process, given by number or "self".
inline std::vector<pid_t> threads_named(const std::string& process, const std::string& name) {
  std::vector<pid_t> threads;
  for (const auto& entry : std::filesystem::directory_iterator("/proc/" + process + "/task")) {
    std::ifstream file(entry.path() / "comm");
    std::string found;
    std::getline(file, found);
    if (found == name) threads.push_back(static_cast<pid_t>(std::stol(entry.path().filename().string())));
  }
  return threads;
}

}  // namespace nilio::tests
