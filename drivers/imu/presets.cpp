#include "nilio/core/units.hpp"
#include "nilio/drivers/common/nearest_name.hpp"
#include "nilio/drivers/imu/mapping.hpp"

namespace nilio::drivers {
namespace {

/// A file of config/dbc; the list is generated at build time (cmake/embed_dbc.cmake).
struct EmbeddedDbc {
  std::string_view name;
  std::string_view text;
};
constexpr EmbeddedDbc kEmbeddedDbc[] = {
#include "embedded_dbc.inc"
};

constexpr double kStandardGravity = 9.80665;
constexpr std::int64_t kMicrosecond = 1'000;

/// The two protocol descriptions differ in the time's unit: 1 us or 100 us.
ImuMapping xsens_mti() {
  return {.name = "xsens_mti",
          .angular_velocity = {{{"RateOfTurn", "gyrX", 1.0},
                                {"RateOfTurn", "gyrY", 1.0},
                                {"RateOfTurn", "gyrZ", 1.0}}},
          .linear_acceleration = {{{"Acceleration", "accX", 1.0},
                                   {"Acceleration", "accY", 1.0},
                                   {"Acceleration", "accZ", 1.0}}},
          .angular_velocity_range = 35.0,
          .linear_acceleration_range = 100.0,
          .counters = {{"GroupCounter", "Counter"}},
          .range_status = {{"StatusWord", "Clipped"}},
          .sample_time = ImuSampleTime{"SampleTime", "Timestamp", {kMicrosecond, 100 * kMicrosecond}},
          .temperature = ImuSignal{"Temperature", "Temperature"}};
}

/// Vehicle axes x forward, y right, z down: y and z change sign. Angular rates in degrees per second.
ImuMapping oxts_rt3003() {
  return {.name = "oxts_rt3003",
          .angular_velocity = {{{"RateVehicle", "AngRateX", kRadiansPerDegree},
                                {"RateVehicle", "AngRateY", -kRadiansPerDegree},
                                {"RateVehicle", "AngRateZ", -kRadiansPerDegree}}},
          .linear_acceleration = {{{"AccelVehicle", "AccelX", 1.0},
                                   {"AccelVehicle", "AccelY", -1.0},
                                   {"AccelVehicle", "AccelZ", -1.0}}}};
}

/// Axes x forward, y right, z down. Status bits: communication, self-test and each of the six sensors.
ImuMapping sbg_ellipse() {
  return {.name = "sbg_ellipse",
          .angular_velocity = {{{"ImuGyro", "GyroX", 1.0},
                                {"ImuGyro", "GyroY", -1.0},
                                {"ImuGyro", "GyroZ", -1.0}}},
          .linear_acceleration = {{{"ImuAccel", "AccelX", 1.0},
                                   {"ImuAccel", "AccelY", -1.0},
                                   {"ImuAccel", "AccelZ", -1.0}}},
          .status = {{"ImuInfo", "Status", 0x00FF, 0x00FF}},
          .range_status = {{"ImuInfo", "Status", 0x0300, 0x0300}},
          .sample_time = ImuSampleTime{"ImuInfo", "TimeStamp", {kMicrosecond}},
          .temperature = ImuSignal{"ImuInfo", "Temperature"}};
}

/// Has no pitch rate. Roll as in the message; its sign differs between customer variants.
ImuMapping bosch_mm5_10() {
  return {.name = "bosch_mm5_10",
          .angular_velocity = {{{"RollRateAx", "RollRate", kRadiansPerDegree},
                                {},
                                {"YawRateAy", "YawRate", kRadiansPerDegree}}},
          .linear_acceleration = {{{"RollRateAx", "Ax", kStandardGravity},
                                   {"YawRateAy", "Ay", kStandardGravity},
                                   {"Az", "Az", kStandardGravity}}}};
}

/// The roll rate has the opposite sign. Status bits: not available, failure, initialising.
ImuMapping bosch_mm7_10() {
  constexpr std::uint64_t kFaults = 7;
  return {.name = "bosch_mm7_10",
          .angular_velocity = {{{"RollRateAx", "RollRate", -kRadiansPerDegree},
                                {"PitchRateAz", "PitchRate", kRadiansPerDegree},
                                {"YawRateAy", "YawRate", kRadiansPerDegree}}},
          .linear_acceleration = {{{"RollRateAx", "Ax", kStandardGravity},
                                   {"YawRateAy", "Ay", kStandardGravity},
                                   {"PitchRateAz", "Az", kStandardGravity}}},
          .counters = {{"YawRateAy", "Counter"}, {"RollRateAx", "Counter"}, {"PitchRateAz", "Counter"}},
          .status = {{"YawRateAy", "YawRateStatus", kFaults},
                     {"YawRateAy", "AyStatus", kFaults},
                     {"RollRateAx", "RollRateStatus", kFaults},
                     {"RollRateAx", "AxStatus", kFaults},
                     {"PitchRateAz", "PitchRateStatus", kFaults},
                     {"PitchRateAz", "AzStatus", kFaults}},
          .temperature = ImuSignal{"YawRateAy", "Temperature"}};
}

/// Axes of the manufacturer: x forward, y right, z down.
ImuMapping aceinna_openimu() {
  // SAE J1939-71: two-byte values from here on mean "error" or "not available".
  constexpr std::uint64_t kNoValue = 0xFE00;
  return {.name = "aceinna_openimu",
          .angular_velocity = {{{"AngularRate", "RateX", kRadiansPerDegree, kNoValue},
                                {"AngularRate", "RateY", -kRadiansPerDegree, kNoValue},
                                {"AngularRate", "RateZ", -kRadiansPerDegree, kNoValue}}},
          .linear_acceleration = {{{"AccelerationSensor", "AccelX", 1.0, kNoValue},
                                   {"AccelerationSensor", "AccelY", -1.0, kNoValue},
                                   {"AccelerationSensor", "AccelZ", -1.0, kNoValue}}}};
}

}  // namespace

core::Result<ImuPreset> imu_preset(std::string_view name) {
  for (const ImuMapping& mapping :
       {xsens_mti(), oxts_rt3003(), sbg_ellipse(), bosch_mm5_10(), bosch_mm7_10(), aceinna_openimu()}) {
    if (mapping.name != name) continue;
    for (const EmbeddedDbc& file : kEmbeddedDbc) {
      if (file.name != name) continue;
      core::Result<DbcDatabase> database = parse_dbc(file.text, "built-in " + mapping.name + ".dbc");
      if (!database) return database.error();
      return ImuPreset{mapping, std::move(database).value()};
    }
  }
  return core::Error{"unknown IMU preset '" + std::string(name) + "'" +
                     nearest_name_hint(name, imu_preset_names())};
}

std::vector<std::string> imu_preset_names() {
  std::vector<std::string> names;
  for (const EmbeddedDbc& file : kEmbeddedDbc) names.emplace_back(file.name);
  return names;
}

}  // namespace nilio::drivers
