#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/time.hpp"
#include "nilio/drivers/can/dbc/dbc.hpp"

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace nilio::drivers {

/// DBC signal of one IMU axis and its conversion to SI units and the axes x forward, y left, z up:
/// value = scale * physical. An empty message means that the device lacks the axis.
struct ImuAxis {
  std::string message;
  std::string signal;
  double scale = 1.0;
  /// Raw values from here on mean "error" or "not available" (SAE J1939).
  std::optional<std::uint64_t> invalid_from{};
};

struct ImuSignal {
  std::string message;
  std::string signal;
};

/// Status signal: good while (raw & mask) == good.
struct ImuStatus {
  std::string message;
  std::string signal;
  std::uint64_t mask = ~std::uint64_t{0};
  std::uint64_t good = 0;
};

/// Time of the sample by the device's own clock, in raw ticks.
struct ImuSampleTime {
  std::string message;
  std::string signal;
  /// Length of a tick, ns. Several values for a device whose firmwares differ: the value that agrees with the
  /// times of arrival is used, or none.
  std::vector<std::int64_t> tick_ns;
  /// Number of ticks at which the counter wraps; 0 = at the limit of its bits.
  std::uint64_t wrap = 0;
};

/// Signals of a DBC database that make an IMU. Only the six axes are required.
struct ImuMapping {
  std::string name;
  std::array<ImuAxis, 3> angular_velocity;     ///< to rad/s
  std::array<ImuAxis, 3> linear_acceleration;  ///< to m/s^2, specific force
  /// Measurement range of the device, SI; 0 = limited by the signals' bits only.
  double angular_velocity_range = 0.0;
  double linear_acceleration_range = 0.0;
  /// Sample counter: in a message of its own, or in each message with an axis.
  std::vector<ImuSignal> counters{};
  /// Samples with a status that is not good are dropped.
  std::vector<ImuStatus> status{};
  /// A range status that is not good marks the sample as saturated.
  std::vector<ImuStatus> range_status{};
  std::optional<ImuSampleTime> sample_time{};
  /// In degrees Celsius.
  std::optional<ImuSignal> temperature{};
  /// Subtracted from every sample's time, whatever its source; positive = samples are stamped too late.
  core::Duration time_offset{};
  /// J1939 messages: accepted sender; nothing = the first sender that is received.
  std::optional<std::uint8_t> source_address{};
};

/// Axes without a signal, as "angular velocity y, linear acceleration z".
std::string missing_axes(const ImuMapping& mapping);

/// A built-in IMU, with its DBC file from config/dbc.
struct ImuPreset {
  ImuMapping mapping;
  DbcDatabase database;
};

/// Fails for unknown names; the error lists the presets.
core::Result<ImuPreset> imu_preset(std::string_view name);
/// Names of all presets, including those that lack axes.
std::vector<std::string> imu_preset_names();

}  // namespace nilio::drivers
