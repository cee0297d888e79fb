#include "daemon/input/imu_input.hpp"

#include "nilio/core/units.hpp"

#include <array>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <utility>

namespace nilio::daemon {

using core::Result;

namespace {

/// Signal mapping from the configuration, used instead of a preset.
drivers::ImuMapping make_mapping(const ImuConfig& config) {
  drivers::ImuMapping mapping;
  mapping.name = config.dbc;
  for (std::size_t i = 0; i < 3; ++i) {
    const ImuAxisConfig& rate = config.angular_velocity[i];
    const ImuAxisConfig& force = config.linear_acceleration[i];
    mapping.angular_velocity[i] = {rate.message, rate.signal, rate.scale};
    mapping.linear_acceleration[i] = {force.message, force.signal, force.scale};
  }
  mapping.angular_velocity_range = config.angular_velocity_range_deg_s * kRadiansPerDegree;
  mapping.linear_acceleration_range = config.linear_acceleration_range;
  if (!config.counter.message.empty())
    mapping.counters.push_back({config.counter.message, config.counter.signal});
  if (!config.status.message.empty()) {
    mapping.status.push_back({config.status.message, config.status.signal,
                              static_cast<std::uint64_t>(config.status.mask),
                              static_cast<std::uint64_t>(config.status.good)});
  }
  if (!config.sample_time.message.empty()) {
    mapping.sample_time =
        drivers::ImuSampleTime{config.sample_time.message,
                               config.sample_time.signal,
                               {static_cast<std::int64_t>(std::llround(config.sample_time.tick_us * 1e3))},
                               static_cast<std::uint64_t>(config.sample_time.wrap)};
  }
  if (!config.temperature.message.empty())
    mapping.temperature = drivers::ImuSignal{config.temperature.message, config.temperature.signal};
  return mapping;
}

/// Message of a mapped signal although no DBC file is configured; empty if there is none.
std::string stray_message(const ImuConfig& config) {
  for (const ImuAxisConfig& axis : config.angular_velocity) {
    if (!axis.message.empty()) return axis.message;
  }
  for (const ImuAxisConfig& axis : config.linear_acceleration) {
    if (!axis.message.empty()) return axis.message;
  }
  for (const std::string* message : {&config.counter.message, &config.status.message,
                                     &config.sample_time.message, &config.temperature.message}) {
    if (!message->empty()) return *message;
  }
  return {};
}

/// Preset with its scales multiplied by the configured scales.
Result<drivers::ImuPreset> scaled_preset(const ImuConfig& config) {
  Result<drivers::ImuPreset> preset = drivers::imu_preset(config.preset);
  if (!preset) return preset;
  for (std::size_t i = 0; i < 3; ++i) {
    preset->mapping.angular_velocity[i].scale *= config.angular_velocity[i].scale;
    preset->mapping.linear_acceleration[i].scale *= config.linear_acceleration[i].scale;
  }
  return preset;
}

Result<drivers::ImuPreset> find_mapping(const ImuConfig& config) {
  if (const std::string stray = stray_message(config); config.dbc.empty() && !stray.empty()) {
    return core::Error{"imu: message '" + stray +
                       "' is mapped without a DBC file; the preset has its own mapping - set imu.dbc to the "
                       "DBC file, or remove the mapping"};
  }
  if (config.dbc.empty()) return scaled_preset(config);
  Result<drivers::DbcDatabase> database = drivers::load_dbc(config.dbc);
  if (!database) return database.error();
  return drivers::ImuPreset{make_mapping(config), std::move(database).value()};
}

}  // namespace

Result<drivers::ImuDecoder> make_imu_decoder(const ImuConfig& config, std::vector<std::string>& warnings) {
  Result<drivers::ImuPreset> imu = find_mapping(config);
  if (!imu) return imu.error();
  const std::vector<std::string>& skipped = imu->database.warnings;
  warnings.insert(warnings.end(), skipped.begin(), skipped.end());
  imu->mapping.time_offset = core::Duration::from_milliseconds(config.time_offset_ms);
  if (config.source_address >= 0)
    imu->mapping.source_address = static_cast<std::uint8_t>(config.source_address);
  Result<drivers::ImuDecoder> decoder = drivers::ImuDecoder::create(imu->mapping, imu->database);
  // A mapped signal may be missing because it was skipped.
  if (!decoder && !skipped.empty())
    return core::Error{decoder.error().message + " (skipped: " + skipped.front() + ")"};
  return decoder;
}

bool is_imu_auto(const ImuConfig& config) { return config.dbc.empty() && config.preset == "auto"; }

std::string imu_name(const ImuConfig& config) { return config.dbc.empty() ? config.preset : config.dbc; }

namespace {

/// Adds notes about assumptions: a configured time offset, an axis that the IMU does not measure.
void note_assumptions(const ImuConfig& config, const std::string& taken_as_zero, Input& input) {
  if (!taken_as_zero.empty()) input.notes.push_back("the IMU has no " + taken_as_zero + ": taken as 0");
  if (config.time_offset_ms == 0.0) return;
  std::array<char, 160> text{};
  std::snprintf(text.data(), text.size(),
                "imu.time_offset_ms: IMU stamps are %.3f ms %s than the LiDAR's and are corrected",
                std::abs(config.time_offset_ms), config.time_offset_ms > 0.0 ? "later" : "earlier");
  input.notes.emplace_back(text.data());
}

/// Identification among all presets, each as configured otherwise (scales, time offset).
Result<std::unique_ptr<drivers::ImuIdentification>> make_identification(const ImuConfig& config) {
  std::vector<drivers::ImuCandidate> candidates;
  std::vector<std::string> ignored;
  core::Error problem;
  for (const std::string& name : drivers::imu_preset_names()) {
    ImuConfig candidate = config;
    candidate.preset = name;
    Result<drivers::ImuDecoder> decoder = make_imu_decoder(candidate, ignored);
    if (decoder) {
      candidates.push_back({name, std::move(decoder).value()});
    } else {
      problem = decoder.error();
    }
  }
  if (candidates.empty()) return problem;
  return std::make_unique<drivers::ImuIdentification>(std::move(candidates));
}

/// True if a sample decodes from the frames.
bool has_sample(drivers::ImuDecoder decoder, drivers::FrameSource& frames) {
  const auto slots = std::make_unique<std::array<drivers::CanFrame, 64>>();
  for (;;) {
    const drivers::SourceRead read = frames.read(*slots, core::Duration{});
    for (const drivers::CanFrame& frame : std::span(*slots).first(read.count)) {
      if (decoder.add(frame)) return true;
    }
    if (read.state != drivers::SourceState::kData) return false;
  }
}

core::Error no_sample(const ImuConfig& config, const std::string& log) {
  const std::filesystem::path folder = std::filesystem::path(log).parent_path();
  const std::string what = is_imu_auto(config) ? "of a built-in IMU (imu.preset: auto)"
                                               : "of the configured IMU (" + imu_name(config) + ")";
  return core::Error{
      log + ": no sample " + what + " decodes from its frames - see what is in it with 'nilio inspect " +
      (folder.empty() ? "." : folder.string()) + " --write-config nilio.yaml', or set imu.enabled to false"};
}

}  // namespace

Result<std::monostate> find_recorded_imu(const ImuConfig& config, drivers::FrameSource& frames,
                                         const std::string& log, Input& input) {
  ImuConfig found = config;
  std::string note;
  if (is_imu_auto(config)) {
    auto identification = make_identification(config);
    if (!identification) return identification.error();
    const drivers::IdentifiedImu* const imu = (*identification)->identify(frames);
    if (imu == nullptr) return no_sample(config, log);
    found.preset = imu->preset;
    note = ", " + imu->text();
    if (!imu->is_plausible())
      input.warnings.push_back("IMU " + imu->preset + ": " + imu->text() +
                               ", which is not near gravity - check its unit with 'nilio inspect'");
  }
  Result<drivers::ImuDecoder> decoder = make_imu_decoder(found, input.warnings);
  if (!decoder) return decoder.error();
  if (!is_imu_auto(config)) {
    std::vector<std::string> ignored;
    Result<drivers::ImuDecoder> trial = make_imu_decoder(found, ignored);
    if (!trial) return trial.error();
    if (!has_sample(std::move(trial).value(), frames)) return no_sample(config, log);
  }
  input.notes.push_back("IMU " + imu_name(found) + " from " + log + note);
  note_assumptions(config, decoder->taken_as_zero(), input);
  input.imu_decoder.emplace(std::move(decoder).value());
  return std::monostate{};
}

void use_lidar_imu(Input& input) {
  input.has_lidar_imu = true;
  input.notes.emplace_back("IMU of the HDL-32E, from its position packets, at lidar.extrinsic");
}

Result<std::monostate> open_live_imu(const Config& configuration, Input& input) {
  const ImuConfig& config = configuration.imu;
  if (!config.enabled) {
    input.notes.push_back(std::string("imu.enabled: false; ") + kNoImu);
    return std::monostate{};
  }
  const std::string& model = configuration.lidar.model;
  const bool can_be_hdl32e =
      configuration.lidar.position_port != 0 && (model == "auto" || model == "HDL-32E");
  const bool wants_lidar =
      config.source == "hdl32e" || (config.source == "auto" && config.interface_name.empty());
  if (wants_lidar && can_be_hdl32e && (config.source == "hdl32e" || model == "HDL-32E")) {
    use_lidar_imu(input);
    return std::monostate{};
  }
  if (config.source == "hdl32e") {
    return core::Error{"imu.source: hdl32e needs lidar.model HDL-32E or auto (" + model +
                       ") and lidar.position_port (" + std::to_string(configuration.lidar.position_port) +
                       ") - correct them, or set imu.source to can"};
  }
  if (config.interface_name.empty()) {
    // The model is not known yet; other models' position packets carry no motion.
    input.has_lidar_imu = wants_lidar && can_be_hdl32e;
    input.warnings.emplace_back(
        std::string("imu.interface: empty - set it to the IMU's CAN interface, such as can0, or "
                    "imu.enabled to false; ") +
        (input.has_lidar_imu ? "an HDL-32E's own IMU is used; with another LiDAR: " : "") + kNoImu);
    return std::monostate{};
  }
  if (is_imu_auto(config)) {
    auto identification = make_identification(config);
    if (!identification) return identification.error();
    input.imu_identification = std::move(identification).value();
    input.notes.push_back("IMU on CAN " + config.interface_name +
                          " is identified from the first second of its frames (imu.preset: auto)");
    note_assumptions(config, "", input);
  } else {
    Result<drivers::ImuDecoder> decoder = make_imu_decoder(config, input.warnings);
    if (!decoder) return decoder.error();
    input.notes.push_back("IMU " + imu_name(config) + " on CAN " + config.interface_name + ", frames " +
                          decoder->frame_filter().text());
    note_assumptions(config, decoder->taken_as_zero(), input);
    input.imu_decoder.emplace(std::move(decoder).value());
  }
  Result<LiveCan> live = open_live_can(
      config,
      input.imu_decoder ? input.imu_decoder->frame_filter() : input.imu_identification->frame_filter(),
      input.imu_identification.get());
  if (!live) return live.error();
  input.frames = std::move(live->frames);
  input.can_watch = std::move(live->watch);
  return std::monostate{};
}

}  // namespace nilio::daemon
