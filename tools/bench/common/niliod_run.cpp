#include "tools/bench/common/niliod_run.hpp"

#include "daemon/input/receive.hpp"

#include <utility>

namespace nilio::tools {

namespace {

namespace fs = std::filesystem;
using core::Duration;
using core::Error;
using core::Result;

constexpr Duration kPoll = Duration::from_milliseconds(20.0);
constexpr Duration kPatience = Duration::from_seconds(10.0);
/// No drive takes so long; a niliod that hangs would otherwise keep a test waiting for ever.
constexpr Duration kLongestReplay = Duration::from_seconds(4.0 * 3600.0);

}  // namespace

Result<ChildProcess> start_niliod(std::vector<std::string> arguments,
                                  const std::vector<std::string>& overrides, const fs::path& folder,
                                  std::vector<std::string> environment) {
  const Result<fs::path> program = find_sibling_program("niliod");
  if (!program) return program.error();
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) return Error{folder.string() + ": cannot be made (" + error.message() + ")"};
  arguments.insert(arguments.end(), {"--output", folder.string(), "--set", "output.map=false"});
  for (const std::string& assignment : overrides) arguments.insert(arguments.end(), {"--set", assignment});
  return ChildProcess::start(*program, arguments, folder / "niliod.log", std::move(environment));
}

std::vector<std::string> replay_arguments(const daemon::ReplayFiles& files) {
  std::vector<std::string> arguments{"--replay"};
  arguments.insert(arguments.end(), files.captures.begin(), files.captures.end());
  arguments.insert(arguments.end(), files.can_logs.begin(), files.can_logs.end());
  if (!files.configuration.empty()) arguments.insert(arguments.end(), {"--config", files.configuration});
  return arguments;
}

Result<std::monostate> await_end(ChildProcess& program, Duration limit, StopSignals& signals) {
  const std::int64_t deadline = daemon::monotonic_ns() + limit.ns;
  while (!program.poll()) {
    if (signals.wait(kPoll)) {
      program.stop(kPatience);
      return Error{"interrupted"};
    }
    if (daemon::monotonic_ns() > deadline) {
      program.stop(kPatience);
      return Error{"niliod had not ended after " + std::to_string(limit.ns / 1'000'000'000) +
                   " s: " + program.last_line()};
    }
  }
  if (*program.poll() == 0) return std::monostate{};
  return Error{"niliod ended with status " + std::to_string(*program.poll()) + ": " + program.last_line()};
}

Result<RunFigures> run_niliod_over_file(const FileRun& run, const fs::path& folder, StopSignals& signals) {
  std::vector<std::string> arguments = replay_arguments(run.files);
  if (!run.decisions.empty()) arguments.insert(arguments.end(), {"--decisions", run.decisions});
  std::vector<std::string> overrides{"publisher.enabled=false"};
  overrides.insert(overrides.end(), run.overrides.begin(), run.overrides.end());
  Result<ChildProcess> niliod = start_niliod(std::move(arguments), overrides, folder, run.environment);
  if (!niliod) return niliod.error();
  const auto ended = await_end(*niliod, kLongestReplay, signals);
  if (!ended) return ended.error();
  return read_run_figures(folder);
}

}  // namespace nilio::tools
