#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/time.hpp"

#include "daemon/input/replay_files.hpp"
#include "ipc/histogram.hpp"
#include "tools/common/child_process.hpp"
#include "tools/common/system.hpp"
#include "tools/common/trajectory.hpp"

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace nilio::tools::bench {

/// Names and the number of occurrences of each.
using NamedCounts = std::vector<std::pair<std::string, std::uint64_t>>;

/// Figures of a run of niliod, from its output folder.
struct NiliodFigures {
  std::uint64_t scans = 0;
  std::uint64_t poses = 0;
  std::uint64_t packets = 0;          ///< received or read, position packets included
  std::uint64_t packets_lost = 0;     ///< missing in the sensor's stream before niliod
  std::uint64_t packets_dropped = 0;  ///< by the kernel and by niliod because a buffer was full
  std::uint64_t superseded = 0;
  std::uint64_t scans_with_imu = 0;
  std::string clock_source;
  std::string budget_mode;
  std::optional<double> budget_ms;
  NamedCounts degradation_levels;  ///< from the most work to the least
  NamedCounts stops;
  std::uint64_t predicted_by_guard = 0;
  std::uint64_t late_poses = 0;
  std::optional<ipc::LatencySummary> overshoot;   ///< time beyond the budget
  std::optional<ipc::LatencySummary> iteration;   ///< cost of one iteration
  std::optional<ipc::LatencySummary> end_to_end;  ///< last packet received to pose published
  std::string sha256;     ///< of trajectory.kitti, whose bits depend on the poses alone
  Trajectory trajectory;  ///< trajectory.tum; empty without poses
};

/// Reads latency.json and the trajectories. Fails when they are missing or not in niliod's format.
core::Result<NiliodFigures> read_run_figures(const std::filesystem::path& folder);

/// Starts the niliod beside this program. Its output and niliod.log go to `folder`, which is created. Each
/// override becomes a --set; `environment` as in ChildProcess::start().
core::Result<ChildProcess> start_niliod(std::vector<std::string> arguments,
                                        const std::vector<std::string>& overrides,
                                        const std::filesystem::path& folder,
                                        std::vector<std::string> environment = {});

/// "--replay" with the files of a recording, and "--config" if it has one.
std::vector<std::string> replay_arguments(const daemon::ReplayFiles& files);

/// Waits until the program ends. Fails with its last line when its status is not 0. Stops it and fails after
/// `limit` and on a stop signal.
core::Result<std::monostate> await_end(ChildProcess& program, core::Duration limit, StopSignals& signals);

/// niliod over a file, as fast as possible and without the publisher.
struct FileRun {
  daemon::ReplayFiles files;
  std::vector<std::string> overrides;
  std::string decisions = {};  ///< decision log of a run to be repeated; empty = none
  std::vector<std::string> environment = {};
};
/// Waits for its end as await_end() does.
core::Result<NiliodFigures> run_niliod_over_file(const FileRun& run, const std::filesystem::path& folder,
                                                 StopSignals& signals);

}  // namespace nilio::tools::bench
