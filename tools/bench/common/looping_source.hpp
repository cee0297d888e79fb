#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/time.hpp"
#include "nilio/drivers/source.hpp"

#include "tools/bench/common/sensor_drive.hpp"
#include "tools/play/restamp.hpp"

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace nilio::tools {

/// Drives one after the other, again and again, on a time line that goes on: where each begins on it.
struct LoopPlan {
  struct Lap {
    const SensorDrive* drive = nullptr;
    core::Time first;      ///< of the drive's packets, as recorded
    core::Time last;       ///< of the drive's packets, as recorded
    core::Duration shift;  ///< what is added to its stamps
  };
  std::vector<Lap> laps;
  /// Packets after it are left out.
  core::Time end;
  [[nodiscard]] core::Time begin() const { return laps.front().first + laps.front().shift; }
};

/// Between the last packet of a lap and the first of the next.
inline constexpr core::Duration kLapGap = core::Duration::from_milliseconds(100.0);

/// Laps until `length` is filled. Reads each drive once for its stamps. The drives have to outlive the plan.
core::Result<LoopPlan> plan_laps(std::span<const SensorDrive> drives, core::Duration length);

/// The packets of a plan, with the sensor's time in them moved as well, so that neither goes back. Position
/// packets are left out: what they say of the hour cannot be moved.
core::Result<std::unique_ptr<drivers::PacketSource>> loop_packets(const LoopPlan& plan);
/// The CAN frames that were logged while its packets were recorded.
core::Result<std::unique_ptr<drivers::FrameSource>> loop_frames(const LoopPlan& plan);

}  // namespace nilio::tools
