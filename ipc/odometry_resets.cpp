#include "ipc/odometry_resets.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace nilio::ipc {

namespace {

/// Predicted poses in a row after which the odometry resets its map (kRestartAfterFailures of core).
constexpr std::uint64_t kPredictedUntilReset = 30;
/// Change of speed between two poses that is no jump: hard braking with a late scan, m/s.
constexpr double kSpeedChange = 5.0;
/// Error of two poses, m.
constexpr double kPoseError = 0.1;

double norm(const std::array<double, 3>& v) { return std::hypot(v[0], v[1], v[2]); }

}  // namespace

const char* name_of(OdometryReset reset) {
  constexpr std::array names{"none", "initialisation", "not_registered", "not_relocalised", "relocalised"};
  static_assert(names.size() == kOdometryResets);
  return names[static_cast<std::size_t>(reset) % names.size()];
}

bool OdometryResetDetector::is_jump(const PoseRecord& record) const {
  if (record.predicted || without_tracking_ == 0) return false;
  const double seconds = static_cast<double>(record.stamp_ns - last_->stamp_ns) * 1e-9;
  const double speed = std::max(norm(record.linear_velocity), norm(last_->linear_velocity));
  return step_m_ > (speed + kSpeedChange) * seconds + kPoseError;
}

OdometryReset OdometryResetDetector::add(const PoseRecord& record) {
  OdometryReset reset = OdometryReset::kNone;
  without_tracking_before_ = without_tracking_;
  if (last_) {
    step_m_ = norm({record.position[0] - last_->position[0], record.position[1] - last_->position[1],
                    record.position[2] - last_->position[2]});
    const bool was_initialising = last_->state == TrackingState::kInitialising;
    if (record.state == TrackingState::kInitialising) {
      if (!was_initialising) {
        reset = predicted_ >= kPredictedUntilReset ? OdometryReset::kNotRegistered
                                                   : OdometryReset::kNotRelocalised;
      } else if (last_->predicted && !record.predicted) {
        reset = OdometryReset::kInitialisation;
      }
    } else if (!was_initialising && is_jump(record)) {
      reset = OdometryReset::kRelocalised;
    }
  }
  predicted_ = record.predicted ? predicted_ + 1 : 0;
  const bool is_tracked = !record.predicted && record.state != TrackingState::kLost;
  without_tracking_ = is_tracked ? 0 : without_tracking_ + 1;
  last_ = record;
  return reset;
}

}  // namespace nilio::ipc
