#pragma once

#include "nilio/core/result.hpp"

#include "tools/bench/common/niliod_run.hpp"

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace nilio::tools::bench {

/// Forbidden calls of niliod's real-time threads after their warm-up, counted by the preloaded library
/// libnilio-watch.so.
struct ThreadWatch {
  struct Thread {
    std::string name;  ///< "nilio-odometry", for example; includes the calls of its workers
    std::uint64_t seen = 0;
    NamedCounts counts;  ///< "allocation", "lock", ...
  };
  std::vector<Thread> threads;
  /// Calls inside TBB's own task scheduling.
  NamedCounts of_tbb;
  std::uint64_t workers = 0;
  double watched_s = 0.0;
  std::string calls;  ///< call stacks of the first forbidden calls
};

/// Environment variables, "NAME=value", that preload the library into niliod with its report in `folder`.
/// Empty where the library is not beside this program. `plant`: the odometry thread makes one allocation,
/// release and lock, to show that they are counted.
std::vector<std::string> watch_environment(const std::filesystem::path& folder, bool plant = false);
/// Fails with the likely reason when there is no report in `folder`.
core::Result<ThreadWatch> read_thread_watch(const std::filesystem::path& folder);

std::uint64_t total(const NamedCounts& counts);
/// Sum over all threads.
std::uint64_t forbidden_calls(const ThreadWatch& watch);

}  // namespace nilio::tools::bench
