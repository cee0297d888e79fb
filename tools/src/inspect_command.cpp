#include "nilio/drivers/velodyne_calibration.hpp"

#include "commands.hpp"
#include "inspect_config.hpp"
#include "inspect_report.hpp"

#include <filesystem>
#include <fstream>
#include <iostream>
#include <memory>

namespace nilio::tools {

namespace {

constexpr int kUnusable = 1;

struct InspectArguments {
  std::vector<std::string> paths;
  std::string json_path;
  std::string config_path;
  std::string calibration_path;
  std::string sensor;
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
  return write_text(arguments.config_path, make_recording_config(*subject, calibration)) ? 0 : kUnusable;
}

int run_inspect(const InspectArguments& arguments) {
  const RecordingFindings findings = inspect_recording(arguments.paths);
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
      "Exit status: 0 there is something to use, 1 nothing usable, or a file could not be written.");
  command->add_option("recording", arguments->paths, "captures, CAN logs, or folders of them")->required();
  command->add_option("--json", arguments->json_path,
                      "also write the findings as JSON; '-': only JSON, to standard output");
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
