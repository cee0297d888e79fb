#pragma once

#include "nilio/core/result.hpp"

#include "daemon/config/config.hpp"
#include "daemon/input/input.hpp"
#include "daemon/realtime/thread_hook.hpp"

#include <atomic>
#include <filesystem>
#include <string>

namespace nilio::daemon {

struct RunOptions {
  bool replay = false;
  ReplayFiles files;
  bool paced = false;
  bool as_live = false;
  std::string decisions_file;  ///< decision log to repeat; empty: none
  std::string output_folder;   ///< empty: no files
  std::filesystem::path publisher_executable;
  ThreadHook thread_hook = nullptr;
};

/// Runs the daemon: opens the input, starts publisher and pipeline, supervises them, writes outputs and log.
/// Returns when a replay is done or `stop` is set; an error if no pose could be computed. Call from the main
/// thread.
core::Result<std::monostate> supervise(const Config& config, const RunOptions& options,
                                       const std::atomic<bool>& stop);

}  // namespace nilio::daemon
