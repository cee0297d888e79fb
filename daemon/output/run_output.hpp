#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/se3.hpp"
#include "nilio/drivers/capture/record_file.hpp"

#include "daemon/odometry/odometry_loop.hpp"
#include "daemon/output/run_mcap.hpp"
#include "ipc/overwriting_ring.hpp"
#include "ipc/records.hpp"
#include "ipc/scan_cloud.hpp"

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>

namespace nilio::daemon {

/// Line of trajectory.tum for a pose.
std::string tum_line(const ipc::PoseRecord& record);
/// Line of trajectory_mid.tum for the pose in the middle of the sweep.
std::string middle_tum_line(const ipc::PoseRecord& record);

/// Files of one run: trajectory.tum, trajectory_mid.tum, trajectory.kitti, scans.csv, decisions.jsonl,
/// and run.mcap grow during the run, config.yaml is written at the start, latency.json and
/// latency/<stage>.hgrm at the end. While the disk does not accept data, a bounded amount waits in memory and
/// the rest is dropped and counted. One thread.
class RunOutput {
 public:
  struct Options {
    std::string folder;
    /// If set, trajectory.kitti is stated in the camera frame.
    std::optional<core::SE3> T_camera_lidar;
    core::SE3 T_base_lidar;
    bool mcap = true;
    /// Complete submaps for run.mcap; may be null.
    std::shared_ptr<ipc::OverwritingRing<ipc::SubmapCloud>> submaps{};
    RunFrames frames;
  };
  /// Content of files that are written at the end, by path in the folder.
  using FinalFiles = std::map<std::string, std::string>;
  /// Records that the disk did not accept in time.
  struct Lost {
    std::uint64_t poses = 0;
    std::uint64_t decisions = 0;
    std::uint64_t messages = 0;  ///< of run.mcap
    [[nodiscard]] std::uint64_t total() const { return poses + decisions + messages; }
  };

  /// Creates the folder, which must not hold an earlier run; the error names the file that cannot be written.
  /// `report` takes lines about the disk.
  static core::Result<std::unique_ptr<RunOutput>> create(const Options& options,
                                                         const std::string& effective_config,
                                                         drivers::DiskState::Report report);

  void add(const ipc::PoseRecord& record);
  void add(const CloudRecord& cloud);
  /// Adds the submaps that have been completed.
  void take_submaps();
  /// Decisions are written below this first line of decisions.jsonl; call before the first one.
  void open_decisions(const std::string& header);
  void add(const ScanDecision& decision);
  /// Gives the kernel everything added, so that it survives the end of this process. `now_ns`:
  /// CLOCK_MONOTONIC.
  void flush(std::int64_t now_ns);
  /// Flushes and writes the final files, each under a temporary name and renamed, in the order of their
  /// names; returns the first error, such as a full disk.
  core::Result<std::monostate> finish(const FinalFiles& final_files, std::int64_t now_ns);
  [[nodiscard]] const Lost& lost() const { return lost_; }

 private:
  RunOutput(const Options& options, drivers::DiskState::Report report);

  Options options_;
  std::filesystem::path folder_;
  drivers::DiskState disk_;
  drivers::RecordFile tum_;
  drivers::RecordFile middle_tum_;
  drivers::RecordFile kitti_;
  drivers::RecordFile scans_;
  drivers::RecordFile decisions_;
  std::unique_ptr<RunMcap> mcap_;
  std::unique_ptr<ipc::SubmapCloud> submap_;  ///< refilled
  std::optional<core::SE3> T_base_odom_;      ///< inverse of the first pose
  Lost lost_;
};

}  // namespace nilio::daemon
