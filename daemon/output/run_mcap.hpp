#pragma once

#include "nilio/drivers/bag/mcap_writer.hpp"

#include "daemon/odometry/odometry_loop.hpp"
#include "daemon/output/run_messages.hpp"
#include "ipc/messages/diagnostics.hpp"
#include "ipc/odometry_resets.hpp"
#include "ipc/records.hpp"
#include "ipc/scan_cloud.hpp"

#include <cstdint>
#include <filesystem>
#include <optional>
#include <vector>

namespace nilio::daemon {

/// run.mcap of a run: poses, transforms, path, thinned registered scans and submaps, diagnostics and latency,
/// stamped with the time of their scan. One thread.
class RunMcap {
 public:
  /// Poses of the path at most; beyond, every second one is dropped and their distance doubles.
  static constexpr std::size_t kMaxPathPoses = 4096;

  RunMcap(std::filesystem::path path, RunFrames frames);

  void add(const ipc::PoseRecord& record);
  void add(const CloudRecord& cloud);
  /// Logged at the time of the latest pose, when it was complete. One that was added before is left out.
  void add(const ipc::SubmapCloud& submap);
  /// See McapWriter::close_old_chunk().
  void close_old_chunk(std::int64_t now_ns) { writer_.close_old_chunk(now_ns); }
  /// Adds the last path and closes the file.
  void finish();
  [[nodiscard]] drivers::RecordFile& file() { return writer_.file(); }
  [[nodiscard]] std::uint64_t lost() const { return writer_.lost(); }

 private:
  void write(RunChannel channel, std::int64_t stamp_ns);
  void extend_path(const StampedPose& pose);
  void report(const ipc::PoseRecord& record);

  RunFrames frames_;
  drivers::McapWriter writer_;
  std::vector<std::uint8_t> message_;
  std::vector<StampedPose> path_;
  std::int64_t path_period_ns_ = 1'000'000'000;
  std::size_t written_path_poses_ = 0;
  ipc::OdometryResetDetector resets_;
  dds::PoseCounts counts_;
  dds::PoseCounts reported_;
  std::optional<std::int64_t> reported_ns_;
  std::int64_t latest_ns_ = 0;
  std::uint64_t next_submap_ = 0;
};

}  // namespace nilio::daemon
