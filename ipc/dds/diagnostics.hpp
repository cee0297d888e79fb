#pragma once

#include "nilio/core/time.hpp"

#include "ipc/dds/messages.hpp"
#include "ipc/pose_record.hpp"

namespace nilio::dds {

/// What ROS's diagnostics viewers show of nilio: "nilio: odometry" and, where there is an IMU, "nilio: IMU"
/// with a line for each check of it. `now` is the time of the report (CLOCK_REALTIME); `age` how long ago
/// `latest` was taken: older than a second is stale.
DiagnosticArray make_diagnostics(const ipc::PoseRecord& latest, core::Time now, core::Duration age);

}  // namespace nilio::dds
