#include "ipc/dds/reports.hpp"

#include "nilio/core/compute_budget.hpp"
#include "nilio/core/imu_health.hpp"
#include "nilio/core/time.hpp"
#include "nilio/core/tracking.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <string>

namespace nilio::dds {
namespace {

constexpr double kUsPerNs = 1e-3;

// Stages known at delivery, in the order of ipc::Stage.
constexpr std::array<std::string_view, static_cast<std::size_t>(ipc::Stage::kDelivered) + 1> kStageNames{
    "received", "popped", "completed", "started", "filtered", "coarse", "fine", "delivered"};

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
                   {"stop reason", core::name_of(latest.stop_reason)},
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
    text += health.reason == ImuCheck::kCount ? ", not yet confirmed by a turn"
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
  status.values.push_back({"time shift subtracted from its stamps, ms", text_of(health.time_shift_ms)});
  status.values.push_back({"rejections", std::to_string(health.demotions)});
  status.level = level_of(worst);
  status.message = imu_message(health, worst);
  return status;
}

}  // namespace

std::string read_host_id() {
  std::ifstream file("/proc/sys/kernel/random/boot_id");
  std::string id;
  std::getline(file, id);
  return id;
}

ScanReport make_scan_report(const ipc::PoseRecord& record, core::Time taken, core::Time written,
                            const std::string& host_id) {
  ScanReport report;
  report.stamp = {record.stamp_ns};
  report.scan_start = {record.scan_start_ns};
  report.sequence = record.sequence;
  report.state = core::name_of(record.state);
  report.stop_reason = core::name_of(record.stop_reason);
  report.delivered = {record.delivered_realtime_ns};
  report.host_id = host_id;
  for (std::size_t i = 0; i < kStageNames.size(); ++i)
    report.stages.push_back({std::string(kStageNames[i]), record.stage_ns[i]});
  report.stages.push_back({"taken", taken.ns});
  report.stages.push_back({"written", written.ns});
  report.imu_used = record.imu_used;
  report.predicted = record.predicted;
  report.degenerate_axes = record.degenerate_axes;
  report.coverage_deg = record.coverage_deg;
  report.points = record.points;
  report.points_used = record.points_used;
  report.correspondences = record.correspondences;
  report.coarse_iterations = record.coarse_iterations;
  report.fine_iterations = record.fine_iterations;
  report.map_voxels = record.map_voxels;
  report.lost_packets = record.lost_packets;
  report.missing_firings = record.missing_firings;
  report.superseded = record.superseded;
  report.degradation_level = core::name_of(record.degradation_level);
  report.guarded = record.guarded;
  report.overshoot_ns = record.has_deadline ? record.overshoot_ns : 0;
  return report;
}

void fill_stage_latency(std::string_view name, const ipc::Histogram& histogram, StageLatency& row) {
  const ipc::HistogramSnapshot snapshot = histogram.snapshot();
  const ipc::LatencySummary summary = ipc::summarize(name, snapshot);
  row.name = name;
  row.count = summary.count;
  row.p50_us = summary.p50_us;
  row.p90_us = summary.p90_us;
  row.p99_us = summary.p99_us;
  row.p99_9_us = summary.p99_9_us;
  row.max_us = summary.max_us;
  row.buckets.clear();
  row.buckets.reserve(ipc::Histogram::kBuckets / ipc::Histogram::kCoarseGroup);
  for (const ipc::HistogramBucket& bucket : snapshot.coarse_buckets()) {
    row.buckets.push_back({static_cast<double>(bucket.from_ns) * kUsPerNs,
                           static_cast<double>(bucket.to_ns) * kUsPerNs, bucket.count});
  }
}

DiagnosticArray make_diagnostics(const ipc::PoseRecord& latest, core::Time now, core::Duration age) {
  DiagnosticArray diagnostics;
  diagnostics.stamp = now;
  diagnostics.statuses.push_back(odometry_status(latest, age));
  if (latest.has_imu) diagnostics.statuses.push_back(imu_status(latest.imu_health));
  return diagnostics;
}

}  // namespace nilio::dds
