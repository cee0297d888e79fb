#include "daemon/output/run_result.hpp"

#include "daemon/config/schema.hpp"
#include "daemon/output/run_output.hpp"
#include "daemon/realtime/memory_plan.hpp"

#include <algorithm>
#include <filesystem>
#include <gnu/libc-version.h>
#include <sys/resource.h>

#include <nlohmann/json.hpp>

namespace nilio::daemon {

namespace {

namespace fs = std::filesystem;
using core::Result;
using core::TrackingState;
using ipc::OdometryReset;

constexpr std::array kStates{TrackingState::kInitialising, TrackingState::kTracking, TrackingState::kDegraded,
                             TrackingState::kLost};
constexpr std::array kResets{OdometryReset::kInitialisation, OdometryReset::kNotRegistered,
                             OdometryReset::kNotRelocalised, OdometryReset::kRelocalised};

/// Entry of one input that consists of one or several files.
Result<nlohmann::json> input_entry(const std::string& name, const std::vector<fs::path>& files) {
  Sha256 hash;
  std::uint64_t bytes = 0;
  for (const fs::path& file : files) {
    const Result<std::uint64_t> size = hash.add_file(file);
    if (!size) return size.error();
    bytes += *size;
  }
  nlohmann::json entry{{"path", name}, {"bytes", bytes}, {"sha256", hash.hex()}};
  if (files.size() > 1) entry["files"] = files.size();
  return entry;
}

std::vector<fs::path> sequence_files(const fs::path& folder) {
  std::vector<fs::path> files;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder / "velodyne", error)) files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  for (const char* name : {"times.txt", "calib.txt"}) {
    if (fs::exists(folder / name, error)) files.push_back(folder / name);
  }
  return files;
}

}  // namespace

OdometryReset RunTotals::add(const ipc::PoseRecord& record) {
  const OdometryReset reset = detector_.add(record);
  ++poses_;
  ++states_[static_cast<std::size_t>(record.state) % states_.size()];
  ++resets_[static_cast<std::size_t>(reset)];
  path_length_m_ += detector_.step_m();
  if (!last_) first_stamp_ns_ = record.stamp_ns;
  last_ = record;
  trajectory_.add(tum_line(record));
  return reset;
}

RunResult RunTotals::verdict() const {
  const std::uint64_t lost = count(TrackingState::kLost);
  const std::uint64_t resets = count(OdometryReset::kNotRegistered) + count(OdometryReset::kNotRelocalised);
  const bool ends_lost = last_ && last_->state == TrackingState::kLost;
  std::string why;
  if (ends_lost) {
    why = " and at the end";
  } else if (resets > 0) {
    why = "; the map was reset " + std::to_string(resets) +
          " times, the poses before and after do not fit together";
  } else if (static_cast<double>(lost) <= kMaxLostShare * static_cast<double>(poses_)) {
    return {};
  }
  return {kBadResult, "tracking was lost at " + std::to_string(lost) + " of " + std::to_string(poses_) +
                          " poses" + why + " - see the log for the scans, docs/diagnostics.md for causes"};
}

nlohmann::json RunTotals::json() const {
  nlohmann::json states;
  nlohmann::json resets;
  for (const TrackingState state : kStates) states[core::name_of(state)] = count(state);
  for (const OdometryReset reset : kResets) resets[ipc::name_of(reset)] = count(reset);
  const double duration_s = last_ ? static_cast<double>(last_->stamp_ns - first_stamp_ns_) * 1e-9 : 0.0;
  return {{"poses", poses_},
          {"states", states},
          {"resets", resets},
          {"path_length_m", path_length_m_},
          {"duration_s", duration_s},
          {"time_source", last_ ? core::name_of(last_->clock_source) : "none"},
          {"trajectory_sha256", trajectory_.hex()}};
}

Result<nlohmann::json> describe_inputs(const ReplayFiles& files, const Config& config,
                                       const std::string& decisions_file) {
  std::vector<std::string> names = files.captures;
  names.insert(names.end(), files.can_logs.begin(), files.can_logs.end());
  names.insert(names.end(), files.bags.begin(), files.bags.end());
  names.insert(names.end(), {config.imu.dbc, config.lidar.calibration, decisions_file});
  for (const ExtraLidarConfig& lidar : config.more_lidars) {
    if (lidar.enabled) names.push_back(lidar.calibration);
  }
  nlohmann::json inputs = nlohmann::json::array();
  const auto add = [&](const std::string& name,
                       const std::vector<fs::path>& paths) -> Result<std::monostate> {
    Result<nlohmann::json> entry = input_entry(name, paths);
    if (!entry) return entry.error();
    inputs.push_back(*entry);
    return std::monostate{};
  };
  for (const std::string& name : names) {
    if (name.empty()) continue;
    if (auto added = add(name, {name}); !added) return added.error();
  }
  if (!files.kitti_sequence.empty()) {
    if (auto added = add(files.kitti_sequence, sequence_files(files.kitti_sequence)); !added)
      return added.error();
  }
  return inputs;
}

nlohmann::json describe_process(const Config& config) {
  double cpu_s = 0.0;
  for (const auto who : {RUSAGE_SELF, RUSAGE_CHILDREN}) {
    rusage usage{};
    getrusage(who, &usage);
    for (const timeval& time : {usage.ru_utime, usage.ru_stime})
      cpu_s += static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_usec);
  }
  return {
      {"versions", {{"nilio", NILIO_VERSION}, {"compiler", __VERSION__}, {"glibc", gnu_get_libc_version()}}},
      {"configuration_hash", config_hash(config)},
      {"cpu_s", cpu_s},
      {"peak_memory_bytes", memory_use().peak_resident_bytes}};
}

}  // namespace nilio::daemon
