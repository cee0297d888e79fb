#include "tools/commands/command_line.hpp"
#include "tools/commands/commands.hpp"
#include "tools/inspect/inspect.hpp"

#include <memory>

#include <CLI/CLI.hpp>

namespace nilio::tools {

void add_inspect_command(CLI::App& app, int& status) {
  auto options = std::make_shared<inspect::Options>();
  CLI::App* command = app.add_subcommand(
      "inspect",
      "report the contents of captures, ROS bags and CAN logs, and write a configuration for them");
  command->footer(
      "Captures (pcap, pcapng) and CAN logs (candump -L) are recognised by their content; folders are "
      "searched.\n"
      "With LiDAR and IMU the odometry runs, with the recording's own nilio.yaml or --config, and the IMU "
      "is checked against the registered motion: axes, mounting, units, clock. Corrections are printed and "
      "go into --write-config.");
  command->add_option("recording", options->paths, "captures, ROS bags, CAN logs, or folders of them")
      ->required();
  command->add_option("--json", options->json_path,
                      "also write the findings as JSON; '-': only JSON, to standard output");
  command->add_option("--dbc", options->dbc_path,
                      "DBC file to name the messages of CAN logs and decode their signals with");
  command->add_option("--config", options->drive_config_path,
                      "niliod configuration to check the IMU with: preset or DBC mapping, and extrinsics");
  command
      ->add_option("--imu-seconds", options->imu_seconds,
                   "length of the IMU check, from the start of the recording; 0: no check")
      ->check(number_between(0.0, 1e6))
      ->capture_default_str();
  command->add_option("--write-config", options->config_path,
                      "write a nilio.yaml for the recording, with the reasons as comments");
  command->add_option("--write-calibration", options->calibration_path,
                      "HDL-64E: save the calibration that the unit sends in its status stream");
  command->add_option(
      "--sensor", options->sensor,
      "ADDRESS or ADDRESS:PORT of the sensor to write for (default: the one with most packets)");
  command->callback([options, &status] { status = inspect::run(*options); });
}

}  // namespace nilio::tools
