#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/se3.hpp"

#include "daemon/odometry/odometry_loop.hpp"
#include "ipc/histogram.hpp"
#include "ipc/records.hpp"

#include <cstdint>
#include <fstream>
#include <memory>
#include <optional>
#include <string>
#include <unordered_set>
#include <vector>

namespace nilio::daemon {

/// Line of trajectory.tum for a pose.
std::string tum_line(const ipc::PoseRecord& record);

/// Output files of one run, written by the supervisor. trajectory.tum and trajectory.kitti grow with each
/// pose; config.yaml is written at the start, latency.json, latency/<stage>.hgrm and map.ply at the end. One
/// thread.
class RunOutput {
 public:
  struct Options {
    std::string folder;
    /// If set, trajectory.kitti is stated in the camera frame.
    std::optional<core::SE3> T_camera_lidar;
    core::SE3 T_base_lidar;
    bool map = true;
    double map_voxel_m = 0.3;
  };

  /// Creates the folder and opens the files; the error names the file that cannot be written.
  static core::Result<std::unique_ptr<RunOutput>> create(const Options& options,
                                                         const std::string& effective_config);

  void add(const ipc::PoseRecord& record);
  void add(const CloudRecord& cloud);
  /// Creates decisions.jsonl for the scan decisions.
  core::Result<std::monostate> open_decisions(const std::string& header);
  void add(const ScanDecision& decision);
  /// Writes the final files; returns the first write error, such as a full disk.
  core::Result<std::monostate> finish(const std::string& latency_json, const ipc::LatencyHistograms& latency);

  [[nodiscard]] double path_length_m() const { return path_length_m_; }
  [[nodiscard]] std::uint64_t poses() const { return poses_; }

 private:
  explicit RunOutput(const Options& options) : options_(options) {}
  core::Result<std::monostate> write_distributions(const ipc::LatencyHistograms& latency) const;
  core::Result<std::monostate> write_map() const;

  Options options_;
  std::ofstream tum_;
  std::ofstream kitti_;
  std::ofstream decisions_;
  core::SE3 T_base_odom_;  ///< inverse of the first pose
  core::Vector3 last_position_ = core::Vector3::Zero();
  double path_length_m_ = 0.0;
  std::uint64_t poses_ = 0;
  std::unordered_set<std::uint64_t> map_voxels_;
  std::vector<std::array<float, 3>> map_points_;
};

}  // namespace nilio::daemon
