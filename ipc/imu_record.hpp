#pragma once

#include "nilio/core/scan.hpp"

#include <cstdint>

namespace nilio::ipc {

/// IMU sample for the publisher process; passed by value.
struct ImuRecord {
  core::ImuSample sample;
  std::int64_t received_ns = 0;  ///< receive time of its last CAN frame, CLOCK_MONOTONIC
};

}  // namespace nilio::ipc
