#include "tools/simulate/faults/imu_faults.hpp"

#include "nilio/core/units.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <string_view>

namespace nilio::tools::simulate {

using core::Error;
using core::Result;
using core::Vector3;

namespace {

constexpr double kStandardGravity = 9.80665;
/// Sets the fault's field; the value is within the range of its row.
using Setter = void (*)(ImuFaultConfig&, double);

struct NumberFault {
  std::string_view name;
  std::string_view unit;
  double minimum;
  double maximum;
  std::string_view help;
  Setter set;
};

constexpr std::array kNumberFaults = {
    NumberFault{"mounting_roll", "deg", -180.0, 180.0, "mounted rotated about x",
                [](ImuFaultConfig& c, double v) { c.mounting_rotation_deg.x() = v; }},
    NumberFault{"mounting_pitch", "deg", -180.0, 180.0, "mounted rotated about y",
                [](ImuFaultConfig& c, double v) { c.mounting_rotation_deg.y() = v; }},
    NumberFault{"mounting_yaw", "deg", -180.0, 180.0, "mounted rotated about z",
                [](ImuFaultConfig& c, double v) { c.mounting_rotation_deg.z() = v; }},
    NumberFault{"time_offset", "ms", -1000.0, 1000.0, "added to the IMU's stamps",
                [](ImuFaultConfig& c, double v) { c.time_offset_ms = v; }},
    NumberFault{"gyro_bias", "deg/s", -100.0, 100.0, "added to each axis of the gyroscope",
                [](ImuFaultConfig& c, double v) { c.gyro_bias_deg_s = v; }},
    NumberFault{"gyro_range", "deg/s", 0.1, 10000.0, "full scale of the gyroscope",
                [](ImuFaultConfig& c, double v) { c.gyro_range_deg_s = v; }},
    NumberFault{"dropout", "s", 0.0, 3600.0, "no samples for this long, from half way on",
                [](ImuFaultConfig& c, double v) { c.dropout_s = v; }},
    NumberFault{"frames_lost", "%", 0.0, 100.0, "CAN frames lost at random",
                [](ImuFaultConfig& c, double v) { c.frames_lost = 0.01 * v; }},
};

struct PlainFault {
  std::string_view name;
  std::string_view help;
  bool ImuFaultConfig::*flag;
};

constexpr std::array kPlainFaults = {
    PlainFault{"gyro_degrees", "angular rate in deg/s where rad/s are expected",
               &ImuFaultConfig::gyro_in_degrees},
    PlainFault{"accel_g", "acceleration in g where m/s^2 are expected", &ImuFaultConfig::accel_in_g},
    PlainFault{"stuck", "constant values from half way on", &ImuFaultConfig::stuck},
};

constexpr std::string_view kAxesHelp = "axes=SXSYSZ  the axes sent as x, y and z, e.g. axes=zyx or axes=xy-z";

/// "zyx", "-x-y-z"; each axis once.
bool parse_axes(std::string_view text, ImuFaultConfig& config) {
  std::array<bool, 3> seen{};
  for (std::size_t i = 0; i < 3; ++i) {
    const bool negative = text.starts_with('-');
    if (negative) text.remove_prefix(1);
    if (text.empty() || text.front() < 'x' || text.front() > 'z') return false;
    const auto source = static_cast<std::uint8_t>(text.front() - 'x');
    if (seen[source]) return false;
    seen[source] = true;
    config.axis_source[i] = source;
    config.axis_sign[i] = negative ? -1.0 : 1.0;
    text.remove_prefix(1);
  }
  return text.empty();
}

/// Empty if the fault was parsed, else the problem.
std::string parse_number_fault(const NumberFault& fault, std::string_view value, ImuFaultConfig& config) {
  double number = 0.0;
  const char* const end = value.data() + value.size();
  const auto parsed = std::from_chars(value.data(), end, number);
  const bool valid = parsed.ec == std::errc() && parsed.ptr == end;
  if (!valid || !(number >= fault.minimum && number <= fault.maximum)) {
    const auto bound = [](double v) { return std::to_string(static_cast<long>(std::ceil(v))); };
    return "takes a number of " + std::string(fault.unit) + " between " + bound(fault.minimum) + " and " +
           bound(fault.maximum) + ", as in " + std::string(fault.name) + "=" + bound(0.1 * fault.maximum);
  }
  fault.set(config, number);
  return {};
}

std::string parse_imu_fault(std::string_view name, std::string_view value, ImuFaultConfig& config) {
  if (name == "axes") return parse_axes(value, config) ? "" : "takes three axes, as in axes=zyx or axes=xy-z";
  for (const NumberFault& fault : kNumberFaults) {
    if (fault.name == name) return parse_number_fault(fault, value, config);
  }
  for (const PlainFault& fault : kPlainFaults) {
    if (fault.name != name) continue;
    if (!value.empty()) return "takes no value";
    config.*fault.flag = true;
    return {};
  }
  return "is not a fault; there are\n" + describe_imu_faults();
}

}  // namespace

Result<ImuFaultConfig> parse_imu_faults(const std::vector<std::string>& faults) {
  ImuFaultConfig config;
  for (const std::string& fault : faults) {
    const std::string_view text = fault;
    const std::size_t name_end = std::min(text.find('='), text.size());
    const std::string_view value = text.substr(std::min(name_end + 1, text.size()));
    const std::string problem = parse_imu_fault(text.substr(0, name_end), value, config);
    if (!problem.empty()) return Error{"--imu-fault " + fault + ": " + problem};
  }
  return config;
}

std::string describe_imu_faults() {
  std::string text = "  " + std::string(kAxesHelp);
  for (const NumberFault& fault : kNumberFaults) {
    text += "\n  " + std::string(fault.name) + "=VALUE  " + std::string(fault.help) + ", " +
            std::string(fault.unit);
  }
  for (const PlainFault& fault : kPlainFaults)
    text += "\n  " + std::string(fault.name) + "  " + std::string(fault.help);
  return text;
}

ImuFaults::ImuFaults(const ImuFaultConfig& config, core::Time start, double duration_s, std::uint64_t seed)
    : config_(config), onset_(start + core::Duration::from_seconds(0.5 * duration_s)), random_(seed, 53) {}

ImuFaults::Values ImuFaults::as_mounted(const Values& values) const {
  const Vector3 rpy = config_.mounting_rotation_deg / kDegreesPerRadian;
  const Eigen::Quaterniond R_expected_actual = Eigen::AngleAxisd(rpy.z(), Vector3::UnitZ()) *
                                               Eigen::AngleAxisd(rpy.y(), Vector3::UnitY()) *
                                               Eigen::AngleAxisd(rpy.x(), Vector3::UnitX());
  const Vector3 turned = R_expected_actual.conjugate() * Vector3(values[0], values[1], values[2]);
  return {turned.x(), turned.y(), turned.z()};
}

ImuFaults::Values ImuFaults::in_wrong_axes(const Values& values) const {
  Values result{};
  for (std::size_t i = 0; i < 3; ++i) result[i] = config_.axis_sign[i] * values[config_.axis_source[i]];
  return result;
}

std::optional<core::ImuSample> ImuFaults::apply(const core::ImuSample& sample) {
  const bool after_onset = sample.stamp >= onset_;
  if (after_onset && sample.stamp < onset_ + core::Duration::from_seconds(config_.dropout_s))
    return std::nullopt;
  core::ImuSample faulty = sample;
  if (config_.stuck && after_onset) {
    if (!frozen_) frozen_ = sample;
    faulty.angular_velocity = frozen_->angular_velocity;
    faulty.linear_acceleration = frozen_->linear_acceleration;
  }
  faulty.angular_velocity = as_mounted(faulty.angular_velocity);
  faulty.linear_acceleration = as_mounted(faulty.linear_acceleration);
  for (double& rate : faulty.angular_velocity) {
    rate += config_.gyro_bias_deg_s / kDegreesPerRadian;
    const double range = config_.gyro_range_deg_s / kDegreesPerRadian;
    if (range > 0.0) rate = std::clamp(rate, -range, range);
    if (config_.gyro_in_degrees) rate *= kDegreesPerRadian;
  }
  if (config_.accel_in_g) {
    for (double& force : faulty.linear_acceleration) force /= kStandardGravity;
  }
  faulty.angular_velocity = in_wrong_axes(faulty.angular_velocity);
  faulty.linear_acceleration = in_wrong_axes(faulty.linear_acceleration);
  faulty.stamp = sample.stamp + core::Duration::from_milliseconds(config_.time_offset_ms);
  return faulty;
}

}  // namespace nilio::tools::simulate
