#include "tools/inspect/inspect.hpp"

#include "nilio/drivers/velodyne/model.hpp"

#include "daemon/config/schema.hpp"
#include "daemon/exit_status.hpp"
#include "daemon/input/input.hpp"
#include "tools/common/progress.hpp"
#include "tools/inspect/config.hpp"
#include "tools/inspect/report/report.hpp"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iostream>
#include <memory>
#include <optional>
#include <utility>

namespace nilio::tools::inspect {

namespace {

int fail(const std::string& message) {
  std::cerr << "nilio inspect: " << message << '\n';
  return kFailed;
}

bool write_text(const std::string& path, const std::string& text) {
  std::ofstream file(path, std::ios::binary);
  file << text;
  file.close();
  if (file) return true;
  fail(path + ": could not be written - check the folder and the space on the disk");
  return false;
}

bool write_json(const RecordingFindings& findings, const Options& options) {
  if (options.json_path == "-") std::cout << inspect_json(findings);
  return options.json_path.empty() || options.json_path == "-" ||
         write_text(options.json_path, inspect_json(findings));
}

core::Result<std::monostate> write_calibration(const SensorFindings& sensor, const std::string& path) {
  const std::string name = address_text(sensor.address);
  if (!sensor.hdl64e)
    return core::Error{"--write-calibration: " + name + " is a " +
                       std::string(drivers::velodyne_model_name(*sensor.model)) +
                       ", which does not send its calibration; its built-in geometry is used"};
  if (!sensor.hdl64e->calibration)
    return core::Error{
        "--write-calibration: the status stream of " + name +
        " has no complete calibration (about 1.2 s without a lost packet carry one); use a longer "
        "recording or the unit's db.xml"};
  const auto calibrated = drivers::with_stream_calibration(drivers::make_velodyne_sensor(*sensor.model),
                                                           *sensor.hdl64e->calibration);
  if (!calibrated) return calibrated.error();
  return drivers::write_calibration_yaml(*calibrated, path);
}

int write_files(const RecordingFindings& findings, const Options& options) {
  if (options.config_path.empty() && options.calibration_path.empty()) return 0;
  const auto subject = choose_config_subject(findings, options.sensor);
  if (!subject) return fail(subject.error().message);
  std::string calibration;
  if (!options.calibration_path.empty()) {
    const auto written = write_calibration(*subject->sensor, options.calibration_path);
    if (!written) return fail(written.error().message);
    // niliod may be started in another folder.
    calibration = std::filesystem::absolute(options.calibration_path).string();
  }
  if (options.config_path.empty()) return 0;
  const DriveFindings* const drive = findings.drive ? &*findings.drive : nullptr;
  return write_text(options.config_path,
                    make_recording_config(*subject, {.calibration_path = calibration, .drive = drive}))
             ? kDone
             : kFailed;
}

/// Files that niliod would replay; unset without a LiDAR and an IMU, for which there is no drive.
std::optional<daemon::ReplayFiles> drivable_files(const Options& options, const RecordingFindings& findings) {
  const bool lidar = std::any_of(findings.captures.begin(), findings.captures.end(),
                                 [](const CaptureFindings& c) { return c.usable(); });
  const bool can = std::any_of(findings.can_logs.begin(), findings.can_logs.end(),
                               [](const CanFindings& c) { return c.usable(); });
  if (!lidar || !can) return std::nullopt;
  auto files = daemon::sort_replay_files(options.paths);
  if (!files || files->captures.empty() || files->can_logs.empty()) return std::nullopt;
  return std::move(files).value();
}

std::function<void(double)> drive_progress(double seconds) {
  const auto progress = std::make_shared<Progress>("checking the IMU", static_cast<std::uint64_t>(seconds));
  return [progress](double done) { progress->update(static_cast<std::uint64_t>(done)); };
}

void check_configured_imu(const Options& options, RecordingFindings& findings) {
  if (options.imu_seconds <= 0.0) return;
  const auto files = drivable_files(options, findings);
  if (!files) return;
  auto config = daemon::replay_config(*files, options.drive_config_path);
  if (!config) {
    findings.drive_problem = config.error().message;
    return;
  }
  const std::string& config_path =
      options.drive_config_path.empty() ? files->configuration : options.drive_config_path;
  if (config_path.empty()) take_imu_from_log(findings, *config);
  check_imu(*files, *config, options.imu_seconds, findings);
  if (findings.drive) findings.drive->config_path = config_path;
}

}  // namespace

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

void check_imu(const daemon::ReplayFiles& files, const daemon::Config& config, double seconds,
               RecordingFindings& findings) {
  double recorded = 0.0;
  for (const CaptureFindings& capture : findings.captures) recorded += capture.duration_s();
  const DriveOptions options{seconds, drive_progress(std::min(seconds, std::max(recorded, 1.0)))};
  core::Result<DriveFindings> drive = inspect_drive(files, config, options);
  if (drive) {
    findings.drive = std::move(drive).value();
  } else {
    findings.drive_problem = drive.error().message;
  }
}

int run(const Options& options) {
  std::optional<drivers::DbcDatabase> dbc;
  if (!options.dbc_path.empty()) {
    auto loaded = drivers::load_dbc(options.dbc_path);
    if (!loaded) return fail(loaded.error().message);
    for (const std::string& warning : loaded->warnings)
      std::cerr << "nilio inspect: warning: " << warning << '\n';
    dbc.emplace(std::move(loaded).value());
  }
  if (!options.drive_config_path.empty()) {
    daemon::Config config;
    if (auto applied = daemon::apply_file(config, options.drive_config_path); !applied)
      return fail(applied.error().message);
  }
  RecordingFindings findings = inspect_recording(options.paths, dbc ? &*dbc : nullptr);
  check_configured_imu(options, findings);
  if (options.json_path != "-") std::cout << inspect_report(findings) << std::flush;
  if (!write_json(findings, options)) return kFailed;
  for (const std::string& problem : findings.problems) fail(problem);
  if (!findings.usable()) return kFailed;
  return write_files(findings, options);
}

}  // namespace nilio::tools::inspect
