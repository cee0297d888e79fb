#include "tools/init/init.hpp"

#include "nilio/core/result.hpp"

#include "daemon/exit_status.hpp"
#include "daemon/input/input.hpp"
#include "daemon/input/replay_files.hpp"
#include "tools/common/files.hpp"
#include "tools/common/system.hpp"
#include "tools/common/text.hpp"
#include "tools/inspect/config.hpp"
#include "tools/inspect/inspect.hpp"
#include "tools/inspect/lidar_mounting.hpp"
#include "tools/record/session.hpp"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <net/if_arp.h>
#include <optional>
#include <utility>

namespace nilio::tools::init {

namespace {

namespace fs = std::filesystem;
using core::Error;
using core::Result;

constexpr core::Duration kPollPeriod = core::Duration::from_milliseconds(100.0);

void say(const std::string& message) { std::cerr << "nilio init: " << message << '\n'; }

int fail(const std::string& message) {
  say(message);
  return kFailed;
}

/// Names of the CAN interfaces that are up.
std::vector<std::string> can_interfaces() {
  std::vector<std::string> names;
  std::error_code error;
  for (fs::directory_iterator entry("/sys/class/net", error), end; !error && entry != end;
       entry.increment(error)) {
    int type = 0;
    std::string flags;
    std::ifstream(entry->path() / "type") >> type;
    std::ifstream(entry->path() / "flags") >> flags;
    const bool is_up = !flags.empty() && (std::strtoul(flags.c_str(), nullptr, 16) & 1U) != 0;
    if (type == ARPHRD_CAN && is_up) names.push_back(entry->path().filename().string());
  }
  std::sort(names.begin(), names.end());
  return names;
}

std::string joined(const std::vector<std::string>& names) {
  std::string text;
  for (const std::string& name : names) text += (text.empty() ? "" : ", ") + name;
  return text;
}

/// Records the live traffic into `folder`; returns what was recorded, for people.
Result<std::string> record_traffic(const Options& options, const fs::path& folder) {
  record::RecordConfig config;
  config.folder = folder;
  config.data_port = options.port;
  config.position_port = options.position_port;
  config.can_interfaces =
      options.can_interface.empty() ? can_interfaces() : std::vector<std::string>{options.can_interface};
  config.priority = 0;
  StopSignals signals;
  auto session = record::RecordSession::open(config, say);
  if (!session) return session.error();
  const std::string sources =
      format("UDP ports %u and %u", options.port, options.position_port) +
      (config.can_interfaces.empty() ? "" : " and CAN " + joined(config.can_interfaces));
  say(format("listening on %s for %.0f s: drive, at least %.0f m of it straight ahead on level ground",
             sources.c_str(), options.seconds, inspect::kMinimumStraightM));
  if (config.can_interfaces.empty()) say("no CAN interface is up: the configuration will have no IMU on CAN");
  (*session)->start();
  const double end_s = monotonic_s() + options.seconds;
  while (monotonic_s() < end_s && !signals.wait(kPollPeriod)) {
    if ((*session)->progress().all_sources_failed) break;
  }
  (*session)->stop();
  if ((*session)->progress().packets > 0) return "live traffic of " + sources;
  std::string message =
      "no LiDAR packets were received on " + sources + " - check power, cable, addresses and firewall";
  for (const std::string& line : (*session)->source_lines(false)) message += "; " + line;
  return Error{message};
}

/// Configuration to find the mounting with: the sensor and the IMU as found.
daemon::Config make_drive_config(const inspect::RecordingFindings& findings,
                                 const inspect::ConfigSubject& subject) {
  daemon::Config config;
  const inspect::SensorFindings& sensor = *subject.sensor;
  config.lidar.port = sensor.data_port;
  if (sensor.telemetry) config.lidar.position_port = sensor.telemetry->port;
  const bool shares_port =
      std::any_of(subject.capture->sensors.begin(), subject.capture->sensors.end(), [&](const auto& other) {
        return other.address != sensor.address && other.data_port == sensor.data_port;
      });
  if (shares_port) config.lidar.sender_address = inspect::address_text(sensor.address);
  inspect::take_imu_from_log(findings, config);
  if (subject.can != nullptr && subject.can->imu() != nullptr)
    config.imu.interface_name = subject.can->imu()->interface_name;
  return config;
}

Result<std::string> make_config(const Options& options, const std::vector<std::string>& paths,
                                const std::string& source) {
  inspect::RecordingFindings findings = inspect::inspect_recording(paths);
  for (const std::string& problem : findings.problems) say(problem);
  const auto subject = inspect::choose_config_subject(findings, options.sensor);
  if (!subject) return subject.error();
  const auto files = daemon::sort_replay_files(paths);
  if (!files) return files.error();
  daemon::Config config = make_drive_config(findings, *subject);
  const auto mounting = inspect::find_lidar_mounting(*files, config, options.seconds);
  if (!mounting) return mounting.error();
  if (mounting->ground_scans > 0) {
    config.lidar.extrinsic.translation = {0.0, 0.0, mounting->height_m};
    const core::Vector3& rpy = mounting->rotation_rpy_deg;
    config.lidar.extrinsic.rotation_rpy_deg = {rpy.x(), rpy.y(), rpy.z()};
  }
  if (subject->can != nullptr && subject->can->imu() != nullptr) {
    inspect::check_imu(*files, config, options.seconds, findings);
    if (!findings.drive_problem.empty()) say("the IMU's mounting was not found: " + findings.drive_problem);
  }
  const inspect::DriveFindings* const drive = findings.drive ? &*findings.drive : nullptr;
  return inspect::make_recording_config(*subject, {.drive = drive, .mounting = &*mounting, .source = source});
}

}  // namespace

int run(const Options& options) {
  std::error_code ignored;
  if (!options.overwrite && fs::exists(options.output, ignored))
    return fail(options.output + ": exists - choose another --output, or replace it with --force");
  std::vector<std::string> paths = options.paths;
  std::optional<WorkFolder> folder;
  std::string source;
  if (paths.empty()) {
    auto created = WorkFolder::create();
    if (!created) return fail(created.error().message);
    folder.emplace(std::move(created).value());
    auto recorded = record_traffic(options, folder->path());
    if (!recorded) return fail(recorded.error().message);
    source = std::move(recorded).value();
    paths = {folder->path().string()};
  }
  const Result<std::string> text = make_config(options, paths, source);
  if (!text) return fail(text.error().message);
  std::ofstream file(options.output, std::ios::binary);
  file << *text;
  file.close();
  if (!file)
    return fail(options.output + ": could not be written - check the folder and the space on the disk");
  std::cout << *text;
  say(options.output + " written; check it with 'niliod --check-config --config " + options.output + "'");
  return kDone;
}

}  // namespace nilio::tools::init
