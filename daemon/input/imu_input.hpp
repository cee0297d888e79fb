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

/// Adds notes about assumptions: a configured time offset, an axis that the IMU does not measure.
void note_assumptions(const ImuConfig& config, const drivers::ImuDecoder& decoder, Input& input);

/// Selects the IMU of the first LiDAR.
void use_lidar_imu(Input& input);

/// Adds the IMU on its CAN interface or in the first LiDAR to a live input, or a note or warning that there
/// is none.
core::Result<std::monostate> open_live_imu(const Config& config, Input& input);

}  // namespace nilio::daemon
