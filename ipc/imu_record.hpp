#pragma once

#include "nilio/core/scan.hpp"

#include <cstdint>

namespace nilio::ipc {

/// A sample on its way to the publisher process; crosses by value.
struct ImuRecord {
  core::ImuSample sample;
  std::int64_t received_ns = 0;  ///< its last CAN frame, CLOCK_MONOTONIC
};

}  // namespace nilio::ipc
