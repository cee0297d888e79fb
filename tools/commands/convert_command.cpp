#include "tools/commands/commands.hpp"
#include "tools/convert/convert.hpp"

#include <iostream>
#include <memory>

#include <CLI/CLI.hpp>

namespace nilio::tools {

namespace {

int run_convert(const convert::Options& options) {
  const auto status = convert::convert_kitti_raw(options);
  if (status) return *status;
  std::cerr << "nilio convert: " << status.error().message << '\n';
  return 1;
}

}  // namespace

void add_convert_command(CLI::App& app, int& status) {
  auto arguments = std::make_shared<convert::Options>();
  CLI::App* command =
      app.add_subcommand("convert", "convert recordings of other projects to the formats that niliod reads");
  command->require_subcommand(1);
  CLI::App* kitti = command->add_subcommand(
      "kitti-raw", "KITTI raw drive to lidar.pcap, imu.candump.log, truth.tum and nilio.yaml");
  kitti->footer(
      "Scans become the HDL-64E packets they were made of and are read back as a check. Reflectance 0..1 is "
      "written as 0..255. The times in KITTI's files have no time zone and are read as UTC. truth.tum is "
      "the LiDAR's trajectory from the OXTS receiver, starting at the identity; without oxts/ there is "
      "neither truth.tum nor imu.candump.log. Scans without a time are left out. Files in OUTPUT_DIR are "
      "replaced.");
  kitti->add_option("drive", arguments->drive, "unpacked drive, <date>/<date>_drive_<number>_sync")
      ->required();
  kitti->add_option("output", arguments->output, "folder for the result, created if missing")->required();
  kitti->add_option(
      "--oxts", arguments->oxts_drive,
      "take the OXTS records from this drive, e.g. <date>_drive_<number>_extract, which has 100 Hz");
  kitti->callback([arguments, &status] { status = run_convert(*arguments); });
}

}  // namespace nilio::tools
