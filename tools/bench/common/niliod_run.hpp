#pragma once

#include "nilio/core/result.hpp"

#include "daemon/input/replay_files.hpp"
#include "tools/bench/odometry/run_figures.hpp"
#include "tools/common/child_process.hpp"
#include "tools/common/stop_signals.hpp"

#include <filesystem>
#include <string>
#include <vector>

namespace nilio::tools {

/// Starts the niliod beside this program with its output and niliod.log in `folder`, which is made. Every
/// override becomes a --set; `environment` as ChildProcess::start() has it.
core::Result<ChildProcess> start_niliod(std::vector<std::string> arguments,
                                        const std::vector<std::string>& overrides,
                                        const std::filesystem::path& folder,
                                        std::vector<std::string> environment = {});

/// "--replay" with the files of a recording, and "--config" if it has one.
std::vector<std::string> replay_arguments(const daemon::ReplayFiles& files);

/// Until the program has ended by itself. Fails when it does so with another status than 0, naming what it
/// said last, and when `signals` has come or it takes longer than `limit`: then it is ended first.
core::Result<std::monostate> await_end(ChildProcess& program, core::Duration limit, StopSignals& signals);

/// niliod over a file, as fast as it goes and without the publisher.
struct FileRun {
  daemon::ReplayFiles files;
  std::vector<std::string> overrides;
  /// decisions.jsonl of a run to be repeated; empty = none.
  std::string decisions;
  std::vector<std::string> environment = {};
};
/// Waits for its end. Fails when niliod does, with what it said last, and when `signals` has come.
core::Result<RunFigures> run_niliod_over_file(const FileRun& run, const std::filesystem::path& folder,
                                              StopSignals& signals);

}  // namespace nilio::tools
