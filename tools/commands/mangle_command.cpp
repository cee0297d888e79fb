#include "daemon/exit_status.hpp"
#include "tools/commands/command_line.hpp"
#include "tools/commands/commands.hpp"
#include "tools/mangle/mangle.hpp"

#include <iostream>
#include <memory>
#include <string>
#include <vector>

#include <CLI/CLI.hpp>

namespace nilio::tools {

namespace {

/// Adds an option of texts that `parse` turns into values of `values`.
template <class Value, class Parse>
void add_parsed_option(CLI::App& command, const std::string& name, std::vector<Value>& values, Parse parse,
                       const std::string& type, const std::string& help) {
  const auto is_valid = [parse](const std::string& text) {
    const auto parsed = parse(text);
    return parsed ? std::string() : parsed.error().message;
  };
  command
      .add_option_function<std::vector<std::string>>(
          name,
          [&values, parse](const std::vector<std::string>& texts) {
            for (const std::string& text : texts) values.push_back(*parse(text));
          },
          help)
      ->check(CLI::Validator(is_valid, ""))
      ->allow_extra_args(false)
      ->type_name(type);
}

void add_stream_options(CLI::App& command, mangle::Faults& f) {
  add_parsed_option(command, "--gap", f.gaps, mangle::parse_timed_fault, "SECONDS@TIME",
                    "the LiDAR is silent; may be repeated");
  command.add_option("--loss", f.loss, "share of packets that are lost")->check(number_between(0.0, 1.0));
  command
      .add_option_function<std::string>(
          "--burst", [&f](const std::string& text) { f.burst = *mangle::parse_burst_loss(text); },
          "COUNT consecutive packets are lost, every SECONDS on average")
      ->check(CLI::Validator(
          [](const std::string& text) {
            const auto parsed = mangle::parse_burst_loss(text);
            return parsed ? std::string() : parsed.error().message;
          },
          ""))
      ->type_name("COUNT/SECONDS");
  command.add_option("--duplicate", f.duplicate, "share of packets that arrive twice")
      ->check(number_between(0.0, 1.0));
  command.add_option("--reorder", f.reorder, "share of packets that change places with the next one")
      ->check(number_between(0.0, 1.0));
  add_parsed_option(command, "--clock-step", f.clock_steps, mangle::parse_timed_fault, "SECONDS@TIME",
                    "the host's clock is set: later receive times of packets and CAN frames are shifted; the "
                    "LiDAR's own time is not");
  command.add_option("--drop-scans", f.drop_scans, "every N-th scan is missing")
      ->check(number_between(2, 1000000))
      ->type_name("N");
  command.add_flag("--reverse", f.reverse, "scans in the reverse order (KITTI sequences)");
}

void add_return_options(CLI::App& command, mangle::Faults& f) {
  command.add_option("--ghosts", f.ghosts, "share of returns with a random range from 2 to 100 m")
      ->check(number_between(0.0, 1.0));
  command.add_option("--thin", f.thin, "share of returns that remain")->check(number_between(0.0, 1.0));
  command.add_option("--points", f.points, "returns a scan that remain, chosen at random")
      ->check(number_between(1, 10000000))
      ->type_name("N");
  command.add_option("--rings", f.rings, "rings that remain, evenly spaced")
      ->check(number_between(1, 128))
      ->type_name("N");
  command.add_option("--noise", f.noise_m, "standard deviation added to the ranges, m")
      ->check(number_between(0.0, 10.0));
  command.add_option("--fov", f.field_of_view_deg, "field of view that remains, centred ahead, degrees")
      ->check(number_between(0.0, 360.0));
  command.add_flag("--vegetation-only", f.vegetation_only,
                   "only returns in voxels of 1 m that scatter in all directions remain");
}

int run_mangle(const mangle::Options& options) {
  const auto fail = [](const core::Error& error, ExitStatus status) {
    std::cerr << "nilio mangle: " << error.message << '\n';
    return status;
  };
  if (const auto checked = mangle::check_faults(options.faults); !checked)
    return fail(checked.error(), kUsageError);
  const core::Result<mangle::Summary> summary = mangle::mangle(options);
  if (!summary) return fail(summary.error(), kFailed);
  std::cout << options.output << ":\n" << mangle::to_text(*summary);
  return kDone;
}

}  // namespace

void add_mangle_command(CLI::App& app, int& status) {
  const auto options = std::make_shared<mangle::Options>();
  CLI::App* const command =
      app.add_subcommand("mangle", "copy a recording with faults of stream and returns");
  command->footer(
      "IN is the folder of a recording (captures and CAN logs), a capture, or a KITTI odometry sequence, "
      "whose "
      "faults are those of scans and returns only. OUT gets lidar.pcap and imu.candump.log, or the scans, "
      "times "
      "and poses of the sequence; truth, configuration and calibration of IN; and mangle.json with the "
      "options "
      "and what they did. It replays and evaluates as the original.\n"
      "Times count from the first packet or scan. Returns are chosen first by ring, view and vegetation, "
      "then by "
      "--thin or --points, then ghosts and noise change their ranges. The same options give the same "
      "bytes.\n\n"
      "Examples:\n"
      "  nilio mangle DRIVE OUT --gap 0.5@30 --loss 0.02          half a second of silence, 2 % of packets "
      "lost\n"
      "  nilio mangle DRIVE OUT --burst 20/1.5 --reorder 0.01     20 packets lost every 1.5 s on average\n"
      "  nilio mangle KITTI/04 OUT --rings 8 --noise 0.1          8 rings, 10 cm of noise\n"
      "  nilio mangle KITTI/04 OUT --vegetation-only              no walls, no ground");
  command->add_option("IN", options->input, "recording to copy")->required();
  command->add_option("OUT", options->output, "new or empty folder")->required();
  add_stream_options(*command, options->faults);
  add_return_options(*command, options->faults);
  command->add_option("--seed", options->faults.seed, "seed of everything that is random")
      ->capture_default_str();
  command->callback([options, &status] { status = run_mangle(*options); });
}

}  // namespace nilio::tools
