#include "nilio/drivers/velodyne/calibration/calibration.hpp"

#include "daemon/input/input.hpp"
#include "tools/common/commands.hpp"
#include "tools/commands/number_between.hpp"
#include "tools/inspect/config.hpp"
#include "tools/inspect/report/report.hpp"
#include "tools/simulate/scenes/progress.hpp"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iostream>
#include <memory>
#include <optional>
#include <unistd.h>

namespace nilio::tools {

namespace {

constexpr int kUnusable = 1;

struct InspectArguments {
  std::vector<std::string> paths;
  std::string json_path;
  std::string config_path;
  std::string calibration_path;
  std::string sensor;
  std::string drive_config_path;
  std::string dbc_path;
  double imu_seconds = 300.0;
};

int fail(const std::string& message) {
  std::cerr << "nilio inspect: " << message << '\n';
  return kUnusable;
}

bool write_text(const std::string& path, const std::string& text) {
  std::ofstream file(path, std::ios::binary);
  file << text;
  file.close();
  if (file) return true;
  fail(path + ": cannot be written; check the folder and the space on the disk");
  return false;
}

bool write_json(const RecordingFindings& findings, const InspectArguments& arguments) {
  if (arguments.json_path == "-") std::cout << inspect_json(findings);
  return arguments.json_path.empty() || arguments.json_path == "-" ||
         write_text(arguments.json_path, inspect_json(findings));
}

core::Result<std::monostate> write_calibration(const SensorFindings& sensor, const std::string& path) {
  const std::string name = address_text(sensor.address);
  if (!sensor.hdl64e)
    return core::Error{"--write-calibration: " + name + " is a " +
                       std::string(drivers::velodyne_model_name(*sensor.model)) +
                       ", which does not send its calibration; the built-in geometry holds for it"};
  if (!sensor.hdl64e->calibration)
    return core::Error{
        "--write-calibration: the status stream of " + name +
        " has no whole calibration (about 1.2 s without a lost packet carry one); use a longer "
        "recording or the unit's db.xml"};
  const auto calibrated = drivers::with_stream_calibration(drivers::make_velodyne_sensor(*sensor.model),
                                                           *sensor.hdl64e->calibration);
  if (!calibrated) return calibrated.error();
  return drivers::write_calibration_yaml(*calibrated, path);
}

int write_files(const RecordingFindings& findings, const InspectArguments& arguments) {
  if (arguments.config_path.empty() && arguments.calibration_path.empty()) return 0;
  const auto subject = choose_config_subject(findings, arguments.sensor);
  if (!subject) return fail(subject.error().message);
  std::string calibration;
  if (!arguments.calibration_path.empty()) {
    const auto written = write_calibration(*subject->sensor, arguments.calibration_path);
    if (!written) return fail(written.error().message);
    // niliod may be started elsewhere.
    calibration = std::filesystem::absolute(arguments.calibration_path).string();
  }
  if (arguments.config_path.empty()) return 0;
  const DriveFindings* const drive = findings.drive ? &*findings.drive : nullptr;
  return write_text(arguments.config_path, make_recording_config(*subject, calibration, drive)) ? 0
                                                                                                : kUnusable;
}

/// What niliod would replay, when that is a LiDAR and an IMU; nothing else can be driven.
std::optional<daemon::ReplayFiles> drivable_files(const InspectArguments& arguments,
                                                  const RecordingFindings& findings) {
  const bool lidar = std::any_of(findings.captures.begin(), findings.captures.end(),
                                 [](const CaptureFindings& c) { return c.usable(); });
  const bool can = std::any_of(findings.can_logs.begin(), findings.can_logs.end(),
                               [](const CanFindings& c) { return c.usable(); });
  if (!lidar || !can) return std::nullopt;
  auto files = daemon::sort_replay_files(arguments.paths);
  if (!files || files->captures.empty() || files->can_logs.empty()) return std::nullopt;
  return std::move(files).value();
}

/// Without a configuration the IMU is the one whose messages are there.
void take_imu_from_log(const RecordingFindings& findings, daemon::Config& config) {
  for (const CanFindings& can : findings.can_logs) {
    const ImuFindings* imu = can.imu();
    if (imu == nullptr && !can.imus.empty() && can.imus.front().stats.samples > 0) imu = &can.imus.front();
    if (imu == nullptr) continue;
    config.imu.preset = imu->preset;
    if (can.interfaces.size() > 1) config.imu.interface_name = imu->interface_name;
    return;
  }
}

std::function<void(double)> drive_progress(double seconds) {
  if (isatty(STDERR_FILENO) != 1) return {};
  const auto progress =
      std::make_shared<simulation::Progress>("checking the IMU", static_cast<std::uint64_t>(seconds));
  return [progress](double done) { progress->update(static_cast<std::uint64_t>(done)); };
}

void check_imu(const InspectArguments& arguments, RecordingFindings& findings) {
  if (arguments.imu_seconds <= 0.0) return;
  const auto files = drivable_files(arguments, findings);
  if (!files) return;
  auto config = daemon::replay_config(*files, arguments.drive_config_path);
  if (!config) {
    findings.drive_problem = config.error().message;
    return;
  }
  const std::string& config_path =
      arguments.drive_config_path.empty() ? files->configuration : arguments.drive_config_path;
  if (config_path.empty()) take_imu_from_log(findings, *config);
  double recorded = 0.0;
  for (const CaptureFindings& capture : findings.captures) recorded += capture.duration_s();
  const double seconds = std::min(arguments.imu_seconds, std::max(recorded, 1.0));
  const DriveOptions options{arguments.imu_seconds, drive_progress(seconds)};
  core::Result<DriveFindings> drive = inspect_drive(*files, *config, options);
  if (!drive) {
    findings.drive_problem = drive.error().message;
    return;
  }
  drive->config_path = config_path;
  findings.drive = std::move(drive).value();
}

int run_inspect(const InspectArguments& arguments) {
  std::optional<drivers::DbcDatabase> dbc;
  if (!arguments.dbc_path.empty()) {
    auto loaded = drivers::load_dbc(arguments.dbc_path);
    if (!loaded) return fail(loaded.error().message);
    dbc.emplace(std::move(loaded).value());
  }
  RecordingFindings findings = inspect_recording(arguments.paths, dbc ? &*dbc : nullptr);
  check_imu(arguments, findings);
  if (arguments.json_path != "-") std::cout << inspect_report(findings) << std::flush;
  if (!write_json(findings, arguments)) return kUnusable;
  for (const std::string& problem : findings.problems) fail(problem);
  if (!findings.usable()) return kUnusable;
  return write_files(findings, arguments);
}

}  // namespace

void add_inspect_command(CLI::App& app, int& status) {
  auto arguments = std::make_shared<InspectArguments>();
  CLI::App* command = app.add_subcommand(
      "inspect", "tell what is in captures and CAN logs, and write a configuration for them");
  command->footer(
      "Captures (pcap, pcapng) and CAN logs (candump -L) are told by their content; folders are looked "
      "through.\n"
      "With LiDAR and IMU the odometry is run, with the recording's own nilio.yaml or --config, and the IMU "
      "is\n"
      "checked against the motion that the LiDAR registers: axes, mounting, units, clock. What would put it "
      "right\n"
      "is printed and goes into --write-config.\n"
      "Exit status: 0 there is something to use, 1 nothing usable, or a file could not be written.");
  command->add_option("recording", arguments->paths, "captures, CAN logs, or folders of them")->required();
  command->add_option("--json", arguments->json_path,
                      "also write the findings as JSON; '-': only JSON, to standard output");
  command->add_option("--dbc", arguments->dbc_path,
                      "DBC file to name the messages of CAN logs and decode their signals with");
  command->add_option("--config", arguments->drive_config_path,
                      "niliod configuration to check the IMU with: preset or DBC mapping, and extrinsics");
  command
      ->add_option("--imu-seconds", arguments->imu_seconds,
                   "how much of the recording the IMU is checked over, from its start; 0: not at all")
      ->check(number_between(0.0, 1e6))
      ->capture_default_str();
  command->add_option("--write-config", arguments->config_path,
                      "write a nilio.yaml for the recording, with the reasons as comments");
  command->add_option("--write-calibration", arguments->calibration_path,
                      "HDL-64E: save the calibration that the unit sends in its status stream");
  command->add_option(
      "--sensor", arguments->sensor,
      "ADDRESS or ADDRESS:PORT of the sensor to write for (default: the one with most packets)");
  command->callback([arguments, &status] { status = run_inspect(*arguments); });
}

}  // namespace nilio::tools
