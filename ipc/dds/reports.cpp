#include "ipc/dds/reports.hpp"

#include "nilio/core/compute_budget.hpp"
#include "nilio/core/time.hpp"
#include "nilio/core/tracking.hpp"

#include <array>
#include <fstream>
#include <string>

namespace nilio::dds {
namespace {

constexpr double kUsPerNs = 1e-3;

// Stages known at delivery, in the order of ipc::Stage.
constexpr std::array<std::string_view, static_cast<std::size_t>(ipc::Stage::kDelivered) + 1> kStageNames{
    "received", "popped", "completed", "started", "filtered", "coarse", "fine", "delivered"};

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
  report.drift_covariance = record.drift_covariance;
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

}  // namespace nilio::dds
