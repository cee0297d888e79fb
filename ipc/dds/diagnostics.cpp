#include "ipc/dds/diagnostics.hpp"

#include "nilio/core/imu_health.hpp"
#include "nilio/core/tracking.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <string>

namespace nilio::dds {

namespace {

using core::ImuCheck;
using core::ImuCheckState;
using Level = DiagnosticStatus::Level;

constexpr core::Duration kStaleAfter{1'000'000'000};

std::string text_of(double value) {
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "%.4g", value);
  return text.data();
}

Level level_of(core::TrackingState state) {
  if (state == core::TrackingState::kTracking) return Level::kOk;
  return state == core::TrackingState::kLost ? Level::kError : Level::kWarn;
}

Level level_of(ImuCheckState state) {
  if (state == ImuCheckState::kBad) return Level::kError;
  return state == ImuCheckState::kWarn ? Level::kWarn : Level::kOk;
}

DiagnosticStatus odometry_status(const ipc::PoseRecord& latest, core::Duration age) {
  DiagnosticStatus status;
  status.name = "nilio: odometry";
  status.level = level_of(latest.state);
  status.message = core::name_of(latest.state);
  if (age > kStaleAfter) {
    status.level = Level::kStale;
    status.message = "no pose for " + text_of(age.seconds()) + " s";
  }
  const auto& v = latest.linear_velocity;
  status.values = {{"state", core::name_of(latest.state)},
                   {"speed, m/s", text_of(std::hypot(v[0], v[1], v[2]))},
                   {"stopped because", core::name_of(latest.stop_reason)},
                   {"points in the scan", std::to_string(latest.points)},
                   {"points registered", std::to_string(latest.points_used)},
                   {"correspondences", std::to_string(latest.correspondences)},
                   {"map voxels", std::to_string(latest.map_voxels)},
                   {"packets lost in the scan", std::to_string(latest.lost_packets)},
                   {"clock", core::name_of(latest.clock_source)},
                   {"IMU used", latest.imu_used ? "yes" : "no"}};
  return status;
}

/// Use of the IMU, and the first of the worst checks.
std::string imu_message(const core::ImuHealth& health, ImuCheckState worst) {
  std::string text = health.trusted ? "used" : "not used";
  if (!health.trusted)
    text += health.reason == ImuCheck::kCount ? ", no bend has proved it yet"
                                              : std::string(" because of ") + core::name_of(health.reason);
  if (worst < ImuCheckState::kWarn) return text;
  for (std::size_t i = 0; i < core::kImuChecks; ++i) {
    const auto check = static_cast<ImuCheck>(i);
    if (health[check].state == worst)
      return text + "; " + core::name_of(check) + ": " + core::hint_for(check, health);
  }
  return text;
}

DiagnosticStatus imu_status(const core::ImuHealth& health) {
  DiagnosticStatus status;
  status.name = "nilio: IMU";
  ImuCheckState worst = ImuCheckState::kUnknown;
  for (std::size_t i = 0; i < core::kImuChecks; ++i) {
    const auto check = static_cast<ImuCheck>(i);
    const core::ImuDiagnosis& row = health[check];
    worst = std::max(worst, row.state);
    const std::string value =
        row.state == ImuCheckState::kUnknown ? "" : text_of(row.value) + " " + core::unit_of(check) + ", ";
    status.values.push_back({core::name_of(check), value + core::name_of(row.state)});
  }
  status.values.push_back({"subtracted from its stamps, ms", text_of(health.time_shift_ms)});
  status.values.push_back({"times that trust was withdrawn", std::to_string(health.demotions)});
  status.level = level_of(worst);
  status.message = imu_message(health, worst);
  return status;
}

}  // namespace

DiagnosticArray make_diagnostics(const ipc::PoseRecord& latest, core::Time now, core::Duration age) {
  DiagnosticArray diagnostics;
  diagnostics.stamp = now;
  diagnostics.statuses.push_back(odometry_status(latest, age));
  if (latest.has_imu) diagnostics.statuses.push_back(imu_status(latest.imu_health));
  return diagnostics;
}

}  // namespace nilio::dds
