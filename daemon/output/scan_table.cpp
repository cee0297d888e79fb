#include "daemon/output/scan_table.hpp"

#include "nilio/core/compute_budget.hpp"
#include "nilio/core/tracking.hpp"

#include "ipc/histogram.hpp"

#include <array>
#include <cmath>
#include <cstdio>

namespace nilio::daemon {

namespace {

/// Duration between two stages as a cell, empty where one of them is unknown.
std::string duration_cell(std::int64_t begin_ns, std::int64_t end_ns) {
  if (begin_ns == 0 || end_ns == 0) return ",";
  std::array<char, 32> cell{};
  std::snprintf(cell.data(), cell.size(), ",%.1f", static_cast<double>(end_ns - begin_ns) * 1e-3);
  return cell.data();
}

}  // namespace

std::string scan_table_header() {
  std::string header =
      "scan,stamp_s,state,stop_reason,degradation_level,degenerate_axes,time_source,imu_used,predicted,"
      "guarded,"
      "speed_m_s,points,points_used,correspondences,coarse_iterations,fine_iterations,map_voxels,lost_"
      "packets,"
      "missing_firings,superseded,overshoot_us";
  for (const std::string_view stage : ipc::kLatencyStageNames) header += "," + std::string(stage) + "_us";
  return header + '\n';
}

std::string scan_table_line(const ipc::PoseRecord& r) {
  std::array<char, 512> cells{};
  const auto& v = r.linear_velocity;
  std::snprintf(cells.data(), cells.size(),
                "%llu,%lld.%09lld,%s,%s,%s,%u,%s,%d,%d,%d,%.4f,%u,%u,%u,%u,%u,%u,%u,%u,%llu",
                static_cast<unsigned long long>(r.sequence),
                static_cast<long long>(r.stamp_ns / 1'000'000'000),
                static_cast<long long>(r.stamp_ns % 1'000'000'000), core::name_of(r.state),
                core::name_of(r.stop_reason), core::name_of(r.degradation_level), unsigned{r.degenerate_axes},
                core::name_of(r.clock_source), r.imu_used ? 1 : 0, r.predicted ? 1 : 0, r.guarded ? 1 : 0,
                std::hypot(v[0], v[1], v[2]), r.points, r.points_used, r.correspondences,
                unsigned{r.coarse_iterations}, unsigned{r.fine_iterations}, r.map_voxels, r.lost_packets,
                r.missing_firings, static_cast<unsigned long long>(r.superseded));
  std::string line = cells.data();
  line += r.has_deadline ? duration_cell(1, r.overshoot_ns + 1) : ",";
  // Latency stage i lies between the stamps i and i + 1.
  for (std::size_t i = 0; i + 1 < ipc::kStageCount; ++i)
    line += duration_cell(r.stage_ns[i], r.stage_ns[i + 1]);
  line += duration_cell(r.stage_ns[static_cast<std::size_t>(ipc::Stage::kReceived)],
                        r.stage_ns[static_cast<std::size_t>(ipc::Stage::kDelivered)]);
  return line + '\n';
}

}  // namespace nilio::daemon
