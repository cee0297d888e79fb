#pragma once

#include <cstdint>

namespace nilio::tools::simulation {

/// What the sensor has of a GPS receiver.
enum class GpsReception : std::uint8_t {
  kLocked,    ///< pulse and time: the sensor's clock is the receiver's
  kNmeaOnly,  ///< time without a pulse: the sensor's clock runs by itself
  kNone,      ///< no receiver
};

}  // namespace nilio::tools::simulation
