#pragma once

#include "nilio/core/scan.hpp"

#include <functional>
#include <optional>

namespace nilio::tests {

/// A fault of an IMU: the faulty sample of a good one, or none where it is lost.
using ImuFault = std::function<std::optional<core::ImuSample>(core::ImuSample)>;

/// Each sample changed in place.
inline ImuFault changed(const std::function<void(core::ImuSample&)>& change) {
  return [change](core::ImuSample sample) {
    change(sample);
    return std::optional(sample);
  };
}

}  // namespace nilio::tests
