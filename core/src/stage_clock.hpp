#pragma once

#include "nilio/core/odometry.hpp"

#include <cstddef>

namespace nilio::core {

/// Stamps the stages of a scan by the injected clock, if there is one.
struct StageClock {
  Odometry::ClockFunction now = nullptr;

  void stamp(OdometryResult& result, OdometryStage stage) const {
    if (now != nullptr) result.stage_ns[static_cast<std::size_t>(stage)] = now();
  }
};

}  // namespace nilio::core
