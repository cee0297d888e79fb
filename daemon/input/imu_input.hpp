#pragma once

#include "nilio/core/result.hpp"
#include "nilio/drivers/imu/decoder.hpp"

#include "daemon/config/config.hpp"
#include "daemon/input/input.hpp"

namespace nilio::daemon {

inline constexpr const char* kNoImu =
    "no IMU: motion is taken to be constant from scan to scan, so sharp turns and braking are tracked less "
    "accurately";

/// The decoder of the preset, or of the DBC and its six mapped signals.
core::Result<drivers::ImuDecoder> make_imu_decoder(const ImuConfig& config);

/// Says what is assumed of the IMU: a time offset, an axis that it lacks.
void note_assumptions(const ImuConfig& config, const drivers::ImuDecoder& decoder, Input& input);

/// Adds the IMU on its CAN interface to a live input, or a note or warning that there is none.
core::Result<std::monostate> open_live_imu(const ImuConfig& config, Input& input);

}  // namespace nilio::daemon
