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

/// One axis of the IMU: which DBC signal carries it and how to bring it to SI units and the IMU's x-forward,
/// y-left, z-up axes: value = scale * physical. Without a message the device does not have the axis.
struct ImuAxis {
  std::string message;
  std::string signal;
  double scale = 1.0;
  /// Raw values from here on say "error" or "not available" (SAE J1939).
  std::optional<std::uint64_t> invalid_from{};
};

struct ImuSignal {
  std::string message;
  std::string signal;
};

/// Fine while (raw & mask) == good.
struct ImuStatus {
  std::string message;
  std::string signal;
  std::uint64_t mask = ~std::uint64_t{0};
  std::uint64_t good = 0;
};

/// When the device took the sample, by its own clock, in raw ticks.
struct ImuSampleTime {
  std::string message;
  std::string signal;
  /// Nanoseconds of a tick. Where it depends on the firmware, give all: the one that agrees with the times of
  /// arrival is used, and none when none does.
  std::vector<std::int64_t> tick_ns;
  /// Ticks after which it begins again; 0 = when its bits are used up.
  std::uint64_t wrap = 0;
};

/// Which signals of a DBC database are an IMU. Only the six axes are needed.
struct ImuMapping {
  std::string name;
  std::array<ImuAxis, 3> angular_velocity;     ///< to rad/s
  std::array<ImuAxis, 3> linear_acceleration;  ///< to m/s^2, specific force
  /// What the device can measure, in SI; 0 = only limited by the signals' bits.
  double angular_velocity_range = 0.0;
  double linear_acceleration_range = 0.0;
  /// Number of the sample: in a message of its own, or in each of those that carry axes.
  std::vector<ImuSignal> counters{};
  /// Samples with one that is not good are dropped.
  std::vector<ImuStatus> status{};
  /// One that is not good says that a value was beyond the device's range.
  std::vector<ImuStatus> range_status{};
  std::optional<ImuSampleTime> sample_time{};
  /// In degrees Celsius.
  std::optional<ImuSignal> temperature{};
  /// Subtracted from every sample's time, whatever it rests on: positive = they come out too late.
  core::Duration time_offset{};
  /// Of messages that the database calls J1939: only frames of this sender; otherwise those of the first one.
  std::optional<std::uint8_t> source_address{};
};

/// "angular velocity y, linear acceleration z": the axes that the mapping has no signals for.
std::string missing_axes(const ImuMapping& mapping);

/// A built-in IMU. The DBC texts are those under config/dbc.
struct ImuPreset {
  ImuMapping mapping;
  DbcDatabase database;
};

/// Fails naming the presets there are.
core::Result<ImuPreset> imu_preset(std::string_view name);
/// All of them, also those that lack axes.
std::vector<std::string> imu_preset_names();

}  // namespace nilio::drivers
