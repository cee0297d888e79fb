#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/time.hpp"

#include "ipc/histogram.hpp"
#include "tools/evaluate/trajectory.hpp"

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace nilio::tools {

/// Names and how often each occurred.
using NamedCounts = std::vector<std::pair<std::string, std::uint64_t>>;

/// What a run of niliod left in its output folder.
struct RunFigures {
  std::uint64_t scans = 0;
  std::uint64_t poses = 0;
  /// Taken from the socket or file, position packets included.
  std::uint64_t packets = 0;
  /// Missing in the sensor's stream, before niliod.
  std::uint64_t packets_lost = 0;
  /// By the kernel and by niliod, for want of room.
  std::uint64_t packets_dropped = 0;
  std::uint64_t superseded = 0;
  std::uint64_t scans_with_imu = 0;
  std::string clock_source;
  std::string budget_mode;
  std::optional<double> budget_ms;
  NamedCounts rungs;
  NamedCounts stops;
  std::uint64_t predicted_by_guard = 0;
  std::uint64_t late_poses = 0;
  /// Past the budget; cost of one iteration; last packet received to pose handed over.
  std::optional<ipc::LatencySummary> overshoot;
  std::optional<ipc::LatencySummary> iteration;
  std::optional<ipc::LatencySummary> end_to_end;
  /// Of trajectory.kitti, whose bits depend on the poses alone.
  std::string sha256;
  /// trajectory.tum; no poses when there were none.
  Trajectory trajectory;
};

/// Reads latency.json and the trajectories. Fails when they are not there or not what niliod writes.
core::Result<RunFigures> read_run_figures(const std::filesystem::path& folder);

/// Mean error over segments of 10 to 80 m in percent; nothing for a path that is shorter or has no truth.
/// `shift` is added to the estimate's stamps.
std::optional<double> translation_error_percent(const std::optional<Trajectory>& truth, Trajectory estimate,
                                                core::Duration shift);

}  // namespace nilio::tools
