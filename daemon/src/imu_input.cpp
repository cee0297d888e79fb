#include "imu_input.hpp"

#include <string>
#include <utility>

namespace nilio::daemon {

using core::Result;

Result<drivers::ImuDecoder> make_imu_decoder(const ImuConfig& config) {
  const auto stamp_offset = core::Duration::from_milliseconds(config.stamp_offset_ms);
  if (config.dbc.empty()) {
    Result<drivers::ImuPreset> preset = drivers::imu_preset(config.preset);
    if (!preset) return preset.error();
    for (std::size_t i = 0; i < 3; ++i) {
      preset->mapping.angular_velocity[i].scale *= config.angular_velocity[i].scale;
      preset->mapping.linear_acceleration[i].scale *= config.linear_acceleration[i].scale;
    }
    preset->mapping.stamp_offset = stamp_offset;
    return drivers::ImuDecoder::create(preset->mapping, preset->database);
  }
  Result<drivers::DbcDatabase> database = drivers::load_dbc(config.dbc);
  if (!database) return database.error();
  drivers::ImuMapping mapping;
  mapping.name = config.dbc;
  mapping.stamp_offset = stamp_offset;
  for (std::size_t i = 0; i < 3; ++i) {
    mapping.angular_velocity[i] = {config.angular_velocity[i].message, config.angular_velocity[i].signal,
                                   config.angular_velocity[i].scale};
    mapping.linear_acceleration[i] = {config.linear_acceleration[i].message,
                                      config.linear_acceleration[i].signal,
                                      config.linear_acceleration[i].scale};
  }
  return drivers::ImuDecoder::create(mapping, *database);
}

Result<std::monostate> open_live_imu(const ImuConfig& config, Input& input) {
  if (!config.enabled) {
    input.notes.push_back(std::string("imu.enabled is false; ") + kNoImu);
    return std::monostate{};
  }
  if (config.interface_name.empty()) {
    input.warnings.emplace_back(
        std::string("imu.interface is empty: set it to the IMU's CAN interface, such as can0, or "
                    "imu.enabled to false; ") +
        kNoImu);
    return std::monostate{};
  }
  Result<drivers::ImuDecoder> decoder = make_imu_decoder(config);
  if (!decoder) return decoder.error();
  Result<LiveCan> live = open_live_can(config, *decoder);
  if (!live) return live.error();
  input.frames = std::move(live->frames);
  input.can_watch = std::move(live->watch);
  input.notes.push_back("IMU " + (config.dbc.empty() ? config.preset : config.dbc) + " on CAN " +
                        config.interface_name + ", frames " + decoder->frame_filter().text());
  input.imu_decoder.emplace(std::move(decoder).value());
  return std::monostate{};
}

}  // namespace nilio::daemon
