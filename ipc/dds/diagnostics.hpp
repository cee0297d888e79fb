#pragma once

#include "nilio/core/time.hpp"

#include "ipc/dds/messages.hpp"
#include "ipc/pose_record.hpp"

namespace nilio::dds {

/// Diagnostics for ROS viewers: "nilio: odometry" and, with an IMU, "nilio: IMU" with one value per check.
/// `now` is the time of the report (CLOCK_REALTIME). `age` is the time since `latest` was taken; more than
/// one second is stale.
DiagnosticArray make_diagnostics(const ipc::PoseRecord& latest, core::Time now, core::Duration age);

}  // namespace nilio::dds
