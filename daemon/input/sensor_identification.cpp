#include "daemon/input/sensor_identification.hpp"

#include "nilio/drivers/velodyne/model.hpp"

#include <chrono>
#include <cstdio>
#include <fstream>
#include <string_view>
#include <utility>
#include <variant>

namespace nilio::daemon {

namespace {

using core::Error;
using core::Result;
using drivers::kHdl64eStatusPackets;

// Enough to identify the model and to see a block of each flag.
constexpr std::size_t kDetectionPackets = 64;
// Two passes contain one whole pass, wherever the stream is joined.
constexpr std::size_t kStreamPackets = 2 * kHdl64eStatusPackets;
constexpr std::size_t kStatusTypeOffset = 1204;
constexpr std::size_t kStatusValueOffset = 1205;
// Types of the status bytes repeated in every cycle; the others carry the calibration table.
constexpr std::string_view kClockTypes = "HMSDNYGTV";

std::string candidate_names(const drivers::VelodyneDetection& detection) {
  std::string names;
  for (const drivers::VelodyneModel model : detection.candidates)
    names += (names.empty() ? "" : " or ") + std::string(drivers::velodyne_model_name(model));
  return names;
}

Result<drivers::VelodyneModel> choose_model(const LidarConfig& config, const std::string& section,
                                            const drivers::VelodyneDetection& detection) {
  const std::string key = section + ".model";
  if (config.model == "auto") {
    if (detection.model) return *detection.model;
    const std::string seen = " (" + detection.evidence + ")";
    if (!detection.candidates.empty())
      return Error{"sensor identified as " + candidate_names(detection) + seen + " - select one with " + key};
    return Error{"sensor model cannot be identified from the packets" + seen + ": set " + key};
  }
  const std::optional<drivers::VelodyneModel> wanted = drivers::parse_velodyne_model(config.model);
  if (!wanted) return Error{key + " '" + config.model + "' is not a known model"};
  if (!detection.candidates.empty() && !detection.agrees_with(*wanted)) {
    return Error{key + " is " + config.model + ", but the packets come from " + candidate_names(detection) +
                 " (" + detection.evidence + ") - correct it, or set " + key + " to auto"};
  }
  return *wanted;
}

Result<drivers::VelodyneSensor> make_sensor(drivers::VelodyneModel model, const LidarConfig& config) {
  drivers::VelodyneSensor sensor = drivers::make_velodyne_sensor(model);
  if (config.azimuth_interpolation != "auto")
    drivers::set_azimuth_interpolation(sensor, config.azimuth_interpolation == "on");
  if (config.calibration.empty()) return sensor;
  return drivers::with_calibration_file(std::move(sensor), config.calibration);
}

std::string date_text(core::Time time) {
  const std::chrono::sys_time<std::chrono::nanoseconds> point{std::chrono::nanoseconds(time.ns)};
  const std::chrono::year_month_day date{std::chrono::floor<std::chrono::days>(point)};
  char text[32];
  std::snprintf(text, sizeof text, "%04d-%02u-%02u", static_cast<int>(date.year()),
                static_cast<unsigned>(date.month()), static_cast<unsigned>(date.day()));
  return text;
}

std::string list_of(const std::vector<std::uint16_t>& numbers) {
  std::string text;
  for (const std::uint16_t number : numbers) text += (text.empty() ? "" : ", ") + std::to_string(number);
  return text;
}

}  // namespace

SensorIdentification::SensorIdentification(const LidarConfig& config, std::string section)
    : config_(config), section_(std::move(section)) {
  sample_.reserve(kDetectionPackets);
}

SensorIdentification::State SensorIdentification::add(const drivers::Packet& packet) {
  if (packet.size != drivers::kDataPacketSize || packet.truncated) return State::kUndecided;
  if (sensor_) return read_status(packet);
  sample_.push_back(packet);
  return sample_.size() < kDetectionPackets ? State::kUndecided : decide_model();
}

SensorIdentification::State SensorIdentification::finish() {
  State state = sensor_ ? State::kUndecided : decide_model();
  if (state == State::kUndecided) state = use_built_in("too few packets");
  return state;
}

SensorIdentification::State SensorIdentification::reject(const std::string& problem) {
  problem_ = problem;
  sample_.clear();
  return State::kRejected;
}

std::string SensorIdentification::model_text() const {
  return "LiDAR " + sensor_->name + (config_.model == "auto" ? " (from the packets)" : "");
}

SensorIdentification::State SensorIdentification::decide_model() {
  const Result<drivers::VelodyneModel> model =
      choose_model(config_, section_, drivers::detect_velodyne(sample_));
  if (!model) return reject(model.error().message);
  Result<drivers::VelodyneSensor> sensor = make_sensor(*model, config_);
  if (!sensor) return reject(sensor.error().message);
  sensor_ = std::move(sensor).value();
  if (!config_.calibration.empty()) {
    notes_.push_back(model_text() + ", calibration " + config_.calibration);
    const std::vector<std::uint16_t> disabled = drivers::disabled_lasers(*sensor_);
    if (!disabled.empty()) notes_.push_back(config_.calibration + " disables laser " + list_of(disabled));
    return State::kIdentified;
  }
  if (sensor_->lasers.size() != drivers::kHdl64eLasers) {
    notes_.push_back(model_text());
    return State::kIdentified;
  }
  for (const drivers::Packet& packet : std::exchange(sample_, {})) read_status(packet);
  return State::kUndecided;
}

SensorIdentification::State SensorIdentification::read_status(const drivers::Packet& packet) {
  const std::uint8_t type = packet.data[kStatusTypeOffset];
  const std::uint8_t value = packet.data[kStatusValueOffset];
  stream_.add(type, value);
  if (stream_.calibration()) return use_stream(*stream_.calibration());
  const drivers::Hdl64eStatusCounters& counters = stream_.counters();
  if (std::exchange(gaps_, counters.gaps) != counters.gaps) {
    packets_since_gap_ = 0;
    carries_table_ = false;
  }
  ++stream_packets_;
  ++packets_since_gap_;
  if (value != 0 && kClockTypes.find(static_cast<char>(type)) == std::string_view::npos)
    carries_table_ = true;
  // Converted recordings have only a clock there, or no status bytes.
  const bool is_empty = counters.cycles == 0 || !carries_table_;
  if (packets_since_gap_ >= kHdl64eStatusPackets && is_empty) return use_built_in("no calibration in it");
  if (stream_packets_ < kStreamPackets) return State::kUndecided;
  if (counters.wrong_crc + counters.implausible > 0)
    return use_built_in("wrong checksum or implausible values");
  return use_built_in("packets are missing");
}

SensorIdentification::State SensorIdentification::use_stream(const drivers::Hdl64eCalibration& calibration) {
  Result<drivers::VelodyneSensor> sensor = drivers::with_stream_calibration(*sensor_, calibration);
  if (!sensor) return use_built_in(sensor.error().message);
  sensor_ = std::move(sensor).value();
  const std::optional<core::Time> date = calibration.unit.calibrated;
  notes_.push_back(model_text() + ", calibration from its own status stream (unit calibrated " +
                   (date ? "on " + date_text(*date) : "on an unknown date") + ")");
  if (calibration.checksum == drivers::Hdl64eChecksum::kNone) {
    warnings_.push_back(
        section_ +
        ": the calibration from the status stream has no checksum: corrupted values are not detected - "
        "compare it with the unit's db.xml");
  }
  return State::kIdentified;
}

SensorIdentification::State SensorIdentification::use_built_in(const std::string& reason) {
  notes_.push_back(model_text() + ", built-in geometry");
  warnings_.push_back(
      section_ + ": every " + sensor_->name +
      " needs its own calibration; the built-in one belongs to another unit, and the status stream "
      "provides none (" +
      reason + "): set " + section_ +
      ".calibration to the unit's db.xml, or to a file from 'nilio inspect "
      "--write-calibration' of a recording");
  return State::kIdentified;
}

Result<std::monostate> check_lidar(const LidarConfig& config, const std::string& section) {
  if (config.model != "auto") {
    const std::optional<drivers::VelodyneModel> model = drivers::parse_velodyne_model(config.model);
    if (!model) return Error{section + ".model '" + config.model + "' is not a known model"};
    const Result<drivers::VelodyneSensor> sensor = make_sensor(*model, config);
    if (!sensor) return sensor.error();
  } else if (!config.calibration.empty() && !std::ifstream(config.calibration)) {
    return Error{config.calibration + ": cannot be read: check " + section + ".calibration"};
  }
  return std::monostate{};
}

std::optional<drivers::VelodyneSensor> configured_sensor(const LidarConfig& config) {
  const std::optional<drivers::VelodyneModel> model = drivers::parse_velodyne_model(config.model);
  if (!model) return std::nullopt;
  Result<drivers::VelodyneSensor> sensor = make_sensor(*model, config);
  const bool may_transmit =
      sensor && config.calibration.empty() && sensor->lasers.size() == drivers::kHdl64eLasers;
  if (!sensor || may_transmit) return std::nullopt;
  return std::move(sensor).value();
}

}  // namespace nilio::daemon
