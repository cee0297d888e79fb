#pragma once

#include "nilio/core/result.hpp"

#include "daemon/config/config.hpp"
#include "daemon/input/input.hpp"
#include "daemon/output/run_result.hpp"
#include "daemon/realtime/run_rules.hpp"
#include "daemon/realtime/thread_hook.hpp"
#include "daemon/service/config_reload.hpp"
#include "daemon/service/service_notifier.hpp"

#include <atomic>
#include <filesystem>
#include <string>
#include <vector>

namespace nilio::daemon {

struct RunOptions {
  RunRules rules = RunRules::Kind::kLive;
  ReplayFiles files;
  std::string decisions_file;  ///< decision log to repeat; empty: none
  std::string output_folder;   ///< empty: no files
  std::string killed_run;      ///< output folder of an earlier run to continue; empty: none
  std::string record_folder;   ///< black box of the run; empty: none
  /// Files and folders that were named for the replay, for the decision log.
  std::vector<std::string> recording;
  std::filesystem::path publisher_executable;
  std::filesystem::path mapper_executable;
  ThreadHook thread_hook = nullptr;
  /// Reads the configuration of this run again, for a reload.
  ConfigReader::Load load_config;
};

/// Requests of signal handlers to a run.
struct RunRequests {
  std::atomic<bool> stop{false};
  std::atomic<bool> reload{false};
};

/// Runs the daemon: opens the input, starts publisher and pipeline, supervises them, writes outputs and log,
/// and reports to the service manager. Returns when a replay is done or a stop is requested; an error if no
/// pose could be computed or the files are incomplete. A replay that is done writes result.json. Call from
/// the main thread.
core::Result<RunResult> supervise(const Config& config, const RunOptions& options, RunRequests& requests,
                                  const ServiceNotifier& service);

}  // namespace nilio::daemon
