#pragma once

#include "nilio/core/result.hpp"

#include "tools/bench/odometry/run_figures.hpp"

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace nilio::tools {

/// What niliod's real-time threads did in a run that they must not do after their warm-up, as the library
/// libnilio-watch.so counted it, which was preloaded.
struct ThreadWatch {
  struct Thread {
    std::string name;  ///< "nilio-odometry"; its workers' calls are its own
    std::uint64_t seen = 0;
    NamedCounts counts;  ///< "allocation", "lock", ...
  };
  std::vector<Thread> threads;
  /// Calls that TBB makes for itself when it hands out tasks.
  NamedCounts of_tbb;
  std::uint64_t workers = 0;
  double watched_s = 0.0;
  /// Call stacks of the first offences; empty for none.
  std::string calls;
};

/// Variables, "NAME=value", that have niliod watched with its report in `folder`; empty where the library is
/// not beside this program. `plant`: the odometry thread allocates once, to show that it is caught.
std::vector<std::string> watch_environment(const std::filesystem::path& folder, bool plant = false);
/// Fails when there is no report in `folder`, saying why there may be none.
core::Result<ThreadWatch> read_thread_watch(const std::filesystem::path& folder);

std::uint64_t total(const NamedCounts& counts);
/// Of all threads.
std::uint64_t offences(const ThreadWatch& watch);

}  // namespace nilio::tools
