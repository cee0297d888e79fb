#include "daemon/command_line.hpp"
#include "daemon/config/schema.hpp"
#include "daemon/log_format.hpp"
#include "daemon/odometry/decision_log.hpp"
#include "daemon/output/log_output.hpp"
#include "daemon/output/output_folder.hpp"
#include "daemon/realtime/memory_plan.hpp"
#include "daemon/realtime/thread_hook.hpp"
#include "daemon/service/service_notifier.hpp"
#include "daemon/supervision/supervisor.hpp"

#include <algorithm>
#include <atomic>
#include <csignal>
#include <dlfcn.h>
#include <filesystem>
#include <iostream>
#include <linux/capability.h>
#include <memory>
#include <string>
#include <sys/prctl.h>
#include <system_error>
#include <unistd.h>
#include <vector>

#include <CLI/CLI.hpp>
#include <spdlog/spdlog.h>

namespace {

using nilio::daemon::Config;
using nilio::daemon::EarlierRun;
using nilio::daemon::ReplayFiles;
using nilio::daemon::RunOptions;
using nilio::daemon::RunRules;

// Signal handlers may only touch these flags.
nilio::daemon::RunRequests requests;
static_assert(std::atomic<bool>::is_always_lock_free);

void request_stop(int /*signal*/) { requests.stop.store(true); }
void request_reload(int /*signal*/) { requests.reload.store(true); }

void install_signal_handlers() {
  struct sigaction action {};
  action.sa_handler = request_stop;
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
  // Threads that receive are not interrupted for it.
  action.sa_flags = SA_RESTART;
  action.sa_handler = request_reload;
  sigaction(SIGHUP, &action, nullptr);
  action.sa_handler = SIG_IGN;
  sigaction(SIGPIPE, &action, nullptr);
}

struct Arguments {
  std::string config_file;
  std::vector<std::string> replay;
  std::vector<std::string> overrides;
  std::string speed = "max";
  std::string output;
  std::string record;
  std::string map;
  std::string decisions;
  bool force = false;
  bool as_live = false;
  bool check_config = false;
  bool print_config = false;
  bool help_config = false;
  std::string config_reference;
};

void add_options(CLI::App& app, Arguments& arguments) {
  app.add_option(
      "--config", arguments.config_file,
      "configuration file (YAML); without one niliod listens on the ports of a Velodyne and publishes");
  app.add_option("--replay", arguments.replay,
                 "replay a folder or files instead of live sensors: capture, CAN log, ROS bag (rosbag1, db3, "
                 "MCAP), or KITTI sequence folder")
      ->expected(1, -1);
  app.add_option("--speed", arguments.speed, "pace of a replay: as recorded, or as fast as possible")
      ->check(CLI::IsMember({"real", "max"}))
      ->capture_default_str();
  app.add_flag(
      "--as-live", arguments.as_live,
      "paced replay under live rules: full rings drop packets, the newest scan wins, the clock limits the "
      "computing time");
  app.add_option("--decisions", arguments.decisions,
                 "run under live rules to repeat bit by bit: a folder of --record or --output, or its "
                 "decisions.jsonl, which names the recording");
  app.add_option("--record", arguments.record,
                 "new folder for a black box of the run: packets with their receive times, CAN frames, "
                 "decisions and configuration; --decisions repeats it");
  app.add_option(
      "--output", arguments.output,
      "output folder: trajectory.tum, trajectory_mid.tum, trajectory.kitti, scans.csv, latency.json, "
      "config.yaml, map.ply, map, run.mcap, and under live rules decisions.jsonl. A replay refuses a folder "
      "with an earlier run; a live run "
      "writes to FOLDER-2, FOLDER-3, ... instead");
  app.add_option("--map", arguments.map,
                 "folder of a saved map to localise in; the same as --set mapper.localise_in=FOLDER");
  app.add_flag("--force", arguments.force, "replace the files of an earlier run in the output folder");
  app.add_option("--set", arguments.overrides,
                 "override one key, such as odometry.threads=2; may be repeated")
      ->take_all()
      ->expected(1);
  app.add_flag("--check-config", arguments.check_config,
               "check the configuration and exit with status 0, or 2 and a line for each error");
  app.add_flag("--print-config", arguments.print_config,
               "print the effective configuration with the origin of each value and exit");
  app.add_flag("--help-config", arguments.help_config, "list all configuration keys and exit");
  app.add_option("--print-config-reference", arguments.config_reference,
                 "print all configuration keys and exit: as docs/configuration.md, config/reference.yaml, or "
                 "config/nilio.schema.json for editors")
      ->check(CLI::IsMember({"markdown", "yaml", "schema"}));
  app.set_version_flag("--version", NILIO_VERSION);
}

int fail(const std::string& message, nilio::ExitStatus status = nilio::kFailed) {
  std::cerr << (nilio::is_journal(STDERR_FILENO) ? "<3>" : "niliod: ") << message << '\n';
  return status;
}

/// Message for options that do not fit together; empty if they do.
std::string find_usage_error(const Arguments& arguments) {
  const bool replay = !arguments.replay.empty();
  if (!replay && arguments.as_live) return "--as-live: no recording given - name it with --replay";
  if (arguments.as_live && !arguments.decisions.empty())
    return "--as-live and --decisions: both given - choose one of them";
  if (arguments.force && arguments.output.empty())
    return "--force: no output folder given - name it with --output";
  if (!arguments.force || arguments.decisions.empty()) return "";
  std::error_code ignored;
  if (std::filesystem::equivalent(std::filesystem::absolute(arguments.decisions).parent_path(),
                                  arguments.output, ignored))
    return "--decisions: is in the output folder, which --force clears - choose another --output";
  return "";
}

RunRules rules_of(const Arguments& arguments) {
  if (arguments.replay.empty()) return RunRules::Kind::kLive;
  if (arguments.as_live) return RunRules::Kind::kReplayAsLive;
  return arguments.speed == "real" ? RunRules::Kind::kPacedReplay : RunRules::Kind::kReplay;
}

/// Configuration of the files with environment and --set applied.
nilio::core::Result<Config> effective_config(const Arguments& arguments, const ReplayFiles& files) {
  auto config = nilio::daemon::replay_config(files, arguments.config_file);
  if (!config) return config.error();
  const auto from_environment = nilio::daemon::apply_environment(*config, environ);
  if (!from_environment) return from_environment.error();
  const auto applied = nilio::daemon::apply_overrides(*config, arguments.overrides);
  if (!applied) return applied.error();
  if (!arguments.map.empty()) config->mapper.localise_in = arguments.map;
  return config;
}

/// Whether the map to localise in lies in the output folder of a replay, which is cleared.
bool clears_map(const Config& config, const Arguments& arguments) {
  if (config.mapper.localise_in.empty() || arguments.output.empty() || arguments.replay.empty()) return false;
  std::error_code ignored;
  const auto map = std::filesystem::weakly_canonical(config.mapper.localise_in, ignored);
  const auto output = std::filesystem::weakly_canonical(arguments.output, ignored);
  return std::mismatch(output.begin(), output.end(), map.begin(), map.end()).first == output.end();
}

nilio::daemon::ThreadHook preloaded_hook() {
  return reinterpret_cast<nilio::daemon::ThreadHook>(dlsym(RTLD_DEFAULT, nilio::daemon::kPreloadedHook));
}

/// Names the recording and the configuration of a run to repeat, unless the user did.
nilio::core::Result<std::monostate> complete_from_decisions(Arguments& arguments) {
  if (arguments.decisions.empty()) return std::monostate{};
  auto run = nilio::daemon::find_run_to_repeat(arguments.decisions, !arguments.replay.empty());
  if (!run) return run.error();
  arguments.decisions = run->decisions;
  if (arguments.replay.empty()) arguments.replay = run->recording;
  if (arguments.config_file.empty()) arguments.config_file = run->configuration;
  return std::monostate{};
}

/// Result of --check-config and --print-config. Without a recording, calibration and DBC files are checked
/// too.
int show_config(const Config& config, const Arguments& arguments) {
  for (const std::string& warning : config.sources.warnings) std::cerr << "niliod: " << warning << '\n';
  if (arguments.check_config && arguments.replay.empty()) {
    const auto checked = nilio::daemon::check_live(config);
    if (!checked) return fail(checked.error().message, nilio::kUsageError);
  }
  if (arguments.check_config)
    std::cerr << "niliod: " << nilio::daemon::describe_sources(config) << "; no errors\n";
  if (arguments.print_config) std::cout << nilio::daemon::to_yaml_with_origins(config);
  return nilio::kDone;
}

int run(Arguments arguments, const nilio::daemon::ServiceNotifier& service) {
  if (const auto completed = complete_from_decisions(arguments); !completed)
    return fail(completed.error().message);
  ReplayFiles files;
  if (!arguments.replay.empty()) {
    const auto found = nilio::daemon::find_replay_files(arguments.replay);
    if (!found) return fail(found.error().message);
    files = *found;
  }
  const auto config = effective_config(arguments, files);
  if (!config) return fail(config.error().message, nilio::kUsageError);
  const auto plan = nilio::daemon::make_thread_plan(*config, rules_of(arguments));
  if (!plan) return fail(plan.error().message, nilio::kUsageError);
  if (arguments.check_config || arguments.print_config) return show_config(*config, arguments);
  const bool replay = !arguments.replay.empty();
  if (clears_map(*config, arguments))
    return fail("mapper.localise_in: " + config->mapper.localise_in +
                    ": is in the output folder of this run - choose another --output",
                nilio::kUsageError);
  const std::string killed_run =
      replay || arguments.force ? std::string() : nilio::daemon::find_killed_run(arguments.output);
  const auto output =
      nilio::daemon::choose_output_folder(arguments.output, arguments.force ? EarlierRun::kOverwrite
                                                            : replay        ? EarlierRun::kRefuse
                                                                            : EarlierRun::kKeep);
  if (!output) return fail(output.error().message);
  nilio::daemon::prepare_heap(*plan);
  RunOptions options;
  options.rules = rules_of(arguments);
  options.files = files;
  options.decisions_file = arguments.decisions;
  options.output_folder = *output;
  options.killed_run = killed_run;
  options.record_folder = arguments.record;
  options.recording = arguments.replay;
  options.thread_hook = preloaded_hook();
  options.load_config = [arguments, files] { return effective_config(arguments, files); };
  options.publisher_executable =
      std::filesystem::read_symlink("/proc/self/exe").parent_path() / "nilio-publisher";
  options.mapper_executable = options.publisher_executable.parent_path() / "nilio-mapper";
  nilio::core::Result<nilio::daemon::RunResult> result = nilio::daemon::RunResult{};
  {
    nilio::daemon::LogOutputConfig log_config;
    log_config.level = config->log.level;
    const nilio::daemon::LogOutput log(log_config);
    nilio::daemon::write_log_before_dying();
    spdlog::info("{}", nilio::daemon::describe_sources(*config));
    for (const std::string& warning : config->sources.warnings) spdlog::warn("{}", warning);
    result = nilio::daemon::supervise(*config, options, requests, service);
  }
  // Printed after the last line of the log.
  if (!result) return fail(result.error().message);
  return result->exit_status == nilio::kDone ? nilio::kDone : fail(result->problem, result->exit_status);
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"niliod: LiDAR-inertial odometry from a Velodyne and an IMU on CAN, published over DDS"};
  Arguments arguments;
  app.formatter(std::make_shared<nilio::HelpFormatter>());
  app.footer(nilio::exit_status_help("niliod"));
  add_options(app, arguments);
  if (const auto status = nilio::parse_command_line(app, argc, argv)) return *status;
  if (arguments.help_config || !arguments.config_reference.empty()) {
    std::cout << (arguments.help_config                      ? nilio::daemon::describe_keys()
                  : arguments.config_reference == "markdown" ? nilio::daemon::reference_markdown()
                  : arguments.config_reference == "yaml"     ? nilio::daemon::reference_yaml()
                                                             : nilio::daemon::reference_schema());
    return nilio::kDone;
  }
  if (const std::string problem = find_usage_error(arguments); !problem.empty())
    return fail(problem, nilio::kUsageError);
  install_signal_handlers();
  // Set by a service that lets niliod configure CAN; nilio-publisher must not inherit it.
  prctl(PR_CAP_AMBIENT, PR_CAP_AMBIENT_LOWER, CAP_NET_ADMIN, 0, 0);
  try {
    return run(arguments, nilio::daemon::ServiceNotifier::from_environment());
  } catch (const std::exception& exception) {
    return fail(std::string("unexpected error: ") + exception.what());
  }
}
