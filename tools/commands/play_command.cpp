#include "daemon/input/input.hpp"
#include "tools/commands/command_line.hpp"
#include "tools/commands/commands.hpp"
#include "tools/common/system.hpp"
#include "tools/play/session.hpp"

#include <array>
#include <cstdio>
#include <ctime>
#include <memory>
#include <string>
#include <sys/prctl.h>
#include <vector>

#include <CLI/CLI.hpp>

namespace nilio::tools {

namespace {

struct PlayArguments {
  play::PlayConfig config;
  std::vector<std::string> recordings;
  double longest_gap_s = 10.0;
};

void log(const std::string& line) { std::fprintf(stderr, "nilio play: %s\n", line.c_str()); }

core::Result<std::unique_ptr<play::PlaySession>> open_session(PlayArguments& arguments) {
  const auto files = daemon::sort_replay_files(arguments.recordings);
  if (!files) return files.error();
  play::PlayConfig& config = arguments.config;
  if (!files->kitti_sequence.empty())
    return core::Error{
        files->kitti_sequence +
        ": a KITTI sequence has no packets to send; 'nilio convert kitti-raw' makes packets of "
        "KITTI's raw drives"};
  if (!files->bags.empty())
    return core::Error{files->bags.front() +
                       ": a ROS bag is replayed by 'niliod --replay', not sent as packets"};
  config.captures = files->captures;
  config.can_logs = files->can_logs;
  config.longest_gap = core::Duration::from_seconds(arguments.longest_gap_s);
  return play::PlaySession::open(config, log);
}

void announce(const play::PlayConfig& config) {
  std::string text = "playing " + std::to_string(config.captures.size()) + " captures";
  if (!config.captures.empty()) text += " to " + config.sender.destination_address;
  if (!config.can_interface.empty())
    text += ", " + std::to_string(config.can_logs.size()) + " CAN logs to " + config.can_interface;
  std::array<char, 48> speed{};
  std::snprintf(speed.data(), speed.size(), "at %g times its own pace", config.speed);
  log(text + ", " + (config.fast ? "as fast as possible" : speed.data()));
  if (config.can_interface.empty() && !config.can_logs.empty())
    log(config.can_logs.front() + " is not played; give --can INTERFACE to play it");
}

/// 0, or 1 if a packet or frame failed.
int print_report(const play::PlayReport& report, bool fast, double seconds) {
  const auto number = [](std::uint64_t value) { return static_cast<unsigned long long>(value); };
  std::printf("played     %llu packets, %llu frames in %.3f s, %llu times to the end\n",
              number(report.packets), number(report.frames), seconds, number(report.loops));
  if (!fast)
    std::printf("late       p50 %.1f us, p99 %.1f us, largest %.1f us\n",
                static_cast<double>(report.late_p50_ns) * 1e-3,
                static_cast<double>(report.late_p99_ns) * 1e-3,
                static_cast<double>(report.late_max_ns) * 1e-3);
  std::printf("not sent   %llu packets and %llu frames failed, %llu skipped (too long, or error frames)\n",
              number(report.packets_failed), number(report.frames_failed), number(report.skipped));
  return report.packets_failed + report.frames_failed > 0 ? 1 : 0;
}

int run_play(PlayArguments& arguments) {
  StopSignals signals;
  auto session = open_session(arguments);
  if (!session) {
    log(session.error().message);
    return 1;
  }
  // The default timer slack delays the end of each sleep by up to 50 us.
  prctl(PR_SET_TIMERSLACK, 1UL);
  announce(arguments.config);
  const double begin_s = monotonic_s();
  const play::PlayReport report = (*session)->run([&signals] { return signals.wait(core::Duration{}); });
  return print_report(report, arguments.config.fast, monotonic_s() - begin_s);
}

void add_destination_options(CLI::App& command, play::PlayConfig& config) {
  command
      .add_option("--to", config.sender.destination_address,
                  "IPv4 address to send packets to: a host, broadcast or multicast")
      ->capture_default_str();
  command.add_option("--from", config.sender.local_address,
                     "own IPv4 address to send from, which chooses the interface for broadcast and multicast "
                     "(default: by the routing table)");
  command.add_option("--port", config.port, "UDP port to send data packets to (default: the recorded one)");
  command.add_option("--position-port", config.position_port,
                     "UDP port to send position packets to (default: the recorded one)");
  command
      .add_option("--recorded-port", config.recorded_port, "UDP port of the data packets in the recording")
      ->capture_default_str();
  command
      .add_option("--recorded-position-port", config.recorded_position_port,
                  "UDP port of the position packets in the recording")
      ->capture_default_str();
  command.add_option("--can", config.can_interface,
                     "CAN interface to send the frames of the CAN log on, independent of the recorded one "
                     "(default: they are not sent)");
}

void add_pace_options(CLI::App& command, PlayArguments& a) {
  CLI::Option* speed = command.add_option("--speed", a.config.speed, "times the recording's own pace")
                           ->check(number_between(0.001, 1000.0))
                           ->capture_default_str();
  command.add_flag("--fast", a.config.fast, "send as fast as possible; receivers may not keep up")
      ->excludes(speed);
  command.add_option("--loop", a.config.loops, "number of repetitions; 0 = until Ctrl-C")
      ->capture_default_str();
  command
      .add_option("--longest-gap", a.longest_gap_s,
                  "skip gaps in the recording that are longer, seconds of its time")
      ->check(number_between(1.0, 1e6))
      ->capture_default_str();
  command.add_flag("--restamp", a.config.restamp,
                   "move the microseconds past the hour in data and position packets to the present");
}

}  // namespace

void add_play_command(CLI::App& app, int& status) {
  auto arguments = std::make_shared<PlayArguments>();
  CLI::App* command =
      app.add_subcommand("play", "send a recording's packets and CAN frames as the sensors do");
  command->footer(
      "RECORDING is a folder of 'nilio record', or captures and candump logs. Packets and frames are sent "
      "by their recorded stamps, on absolute times without drift; a recorded burst is sent as a burst. "
      "Gaps, and stamps that jump back by more than a second, are reported; playing continues after them.\n"
      "--restamp is for live tests: the first packet's time becomes the host's present time, and all others "
      "move by the same amount, modulo one hour; again after each skipped gap and each loop. NMEA sentences "
      "in position packets stay as recorded. It needs the recording's own pace.");
  command->add_option("RECORDING", arguments->recordings, "folder or files to play")->required();
  add_destination_options(*command, arguments->config);
  add_pace_options(*command, *arguments);
  command->callback([arguments, &status] { status = run_play(*arguments); });
}

}  // namespace nilio::tools
