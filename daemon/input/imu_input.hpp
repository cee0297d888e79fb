#pragma once

#include "nilio/core/result.hpp"
#include "nilio/drivers/imu/decoder.hpp"

#include "daemon/config/config.hpp"
#include "daemon/input/input.hpp"

#include <string>
#include <vector>

namespace nilio::daemon {

inline constexpr const char* kNoImu =
    "no IMU: constant velocity is predicted from scan to scan; sharp turns and braking are tracked less "
    "accurately";

/// Creates the decoder from the preset, or from the DBC file and its mapped signals. Adds the DBC file's
/// warnings.
core::Result<drivers::ImuDecoder> make_imu_decoder(const ImuConfig& config,
                                                   std::vector<std::string>& warnings);

/// The IMU is to be identified from its frames.
bool is_imu_auto(const ImuConfig& config);

/// Name of the configured IMU for people: its DBC file, or its preset.
std::string imu_name(const ImuConfig& config);

/// Sets the decoder of a recording's IMU, identified from `frames` with imu.preset auto, and adds notes and
/// warnings. Reads `frames` up to the evidence that the IMU decodes; an error if no sample does. `log` names
/// their file.
core::Result<std::monostate> find_recorded_imu(const ImuConfig& config, drivers::FrameSource& frames,
                                               const std::string& log, Input& input);

/// Selects the IMU of the first LiDAR.
void use_lidar_imu(Input& input);

/// Adds the IMU on its CAN interface or in the first LiDAR to a live input, or a note or warning that there
/// is none.
core::Result<std::monostate> open_live_imu(const Config& config, Input& input);

}  // namespace nilio::daemon
