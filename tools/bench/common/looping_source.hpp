#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/time.hpp"
#include "nilio/drivers/source.hpp"

#include "tools/bench/common/sensor_drive.hpp"
#include "tools/play/timeline.hpp"

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace nilio::tools::bench {

/// Laps of drives that are played one after the other, in a loop, with continuous time.
struct LoopPlan {
  struct Lap {
    const SensorDrive* drive = nullptr;
    core::Time first;      ///< of the drive's packets, as recorded
    core::Time last;       ///< of the drive's packets, as recorded
    core::Duration shift;  ///< added to its stamps
  };
  std::vector<Lap> laps;
  core::Time end;  ///< later packets are left out
  [[nodiscard]] core::Time begin() const { return laps.front().first + laps.front().shift; }
};

/// Time between the last packet of a lap and the first of the next.
inline constexpr core::Duration kLapGap = core::Duration::from_milliseconds(100.0);

/// Plans laps until `length` is filled. Reads each drive once for its stamps. The drives have to outlive the
/// plan.
core::Result<LoopPlan> plan_laps(std::span<const SensorDrive> drives, core::Duration length);

/// Source of the plan's packets. The sensor's time inside them is shifted as well, so that neither clock goes
/// back. Position packets are left out: their time of day cannot be shifted.
core::Result<std::unique_ptr<drivers::PacketSource>> loop_packets(const LoopPlan& plan);
/// Source of the CAN frames of the same laps. Fails for a drive without a CAN log.
core::Result<std::unique_ptr<drivers::FrameSource>> loop_frames(const LoopPlan& plan);

}  // namespace nilio::tools::bench
