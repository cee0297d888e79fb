#include "tools/commands/command_line.hpp"
#include "tools/commands/commands.hpp"
#include "tools/init/init.hpp"

#include <memory>

#include <CLI/CLI.hpp>

namespace nilio::tools {

void add_init_command(CLI::App& app, int& status) {
  const auto options = std::make_shared<init::Options>();
  CLI::App* const command =
      app.add_subcommand("init", "write the configuration of a vehicle from live traffic or a recording");
  command->footer(
      "Finds the LiDAR's model, ports and mounting, and the IMU's preset, CAN interface, mounting, units and "
      "clock, and writes what differs from the defaults with its reasons as comments. Height, roll and pitch "
      "of the LiDAR come from the ground around the vehicle, yaw from straight driving forwards; base_link "
      "is on the ground under the LiDAR, x forward.\n"
      "Drive a minute on level ground, with at least 10 m straight ahead and some bends. A nilio.yaml beside "
      "a recording is not read.");
  command->add_option("source", options->paths,
                      "captures, CAN logs, or folders of them (default: listen to live traffic)");
  command->add_option("--output", options->output, "file to write")->capture_default_str();
  command->add_flag("--force", options->overwrite, "replace the file");
  command
      ->add_option("--seconds", options->seconds,
                   "length of the live traffic, or of the evaluated beginning of a recording")
      ->check(number_between(1.0, 3600.0))
      ->capture_default_str();
  command->add_option("--port", options->port, "live: UDP port of the data packets")->capture_default_str();
  command->add_option("--position-port", options->position_port, "live: UDP port of the position packets")
      ->capture_default_str();
  command->add_option("--can", options->can_interface,
                      "live: CAN interface of the IMU (default: all that are up)");
  command->add_option(
      "--sensor", options->sensor,
      "ADDRESS or ADDRESS:PORT of the sensor to write for (default: the one with most packets)");
  command->callback([options, &status] { status = init::run(*options); });
}

}  // namespace nilio::tools
