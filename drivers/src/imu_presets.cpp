#include "nilio/drivers/imu_decoder.hpp"
#include "nilio/drivers/nearest_name.hpp"

#include "embedded_dbc.hpp"

#include <numbers>

namespace nilio::drivers {
namespace {

constexpr double kRadiansPerDegree = std::numbers::pi / 180.0;

ImuMapping xsens_mti() {
  return {.name = "xsens_mti",
          .angular_velocity = {{{"RateOfTurn", "gyrX", 1.0},
                                {"RateOfTurn", "gyrY", 1.0},
                                {"RateOfTurn", "gyrZ", 1.0}}},
          .linear_acceleration = {
              {{"Acceleration", "accX", 1.0}, {"Acceleration", "accY", 1.0}, {"Acceleration", "accZ", 1.0}}}};
}

/// Vehicle axes x forward, y right, z down and degrees: y and z change sign.
ImuMapping oxts_rt3003() {
  return {.name = "oxts_rt3003",
          .angular_velocity = {{{"RateVehicle", "AngRateX", kRadiansPerDegree},
                                {"RateVehicle", "AngRateY", -kRadiansPerDegree},
                                {"RateVehicle", "AngRateZ", -kRadiansPerDegree}}},
          .linear_acceleration = {{{"AccelVehicle", "AccelX", 1.0},
                                   {"AccelVehicle", "AccelY", -1.0},
                                   {"AccelVehicle", "AccelZ", -1.0}}}};
}

}  // namespace

core::Result<ImuPreset> imu_preset(std::string_view name) {
  for (const ImuMapping& mapping : {xsens_mti(), oxts_rt3003()}) {
    if (mapping.name != name) continue;
    for (const EmbeddedDbc& file : embedded_dbc_files()) {
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
  for (const EmbeddedDbc& file : embedded_dbc_files()) names.emplace_back(file.name);
  return names;
}

}  // namespace nilio::drivers
