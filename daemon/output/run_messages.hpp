#pragma once

#include "nilio/core/time.hpp"
#include "nilio/drivers/bag/mcap_writer.hpp"

#include "daemon/odometry/odometry_loop.hpp"
#include "ipc/messages/messages.hpp"
#include "ipc/records.hpp"
#include "ipc/scan_cloud.hpp"

#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace nilio::daemon {

/// Frames of the messages of a run.
struct RunFrames {
  std::string odom = "odom";
  std::string base = "base_link";
};

/// Numbers of the channels of run.mcap.
enum class RunChannel : std::uint8_t { kOdometry, kTransform, kPath, kScan, kSubmap, kDiagnostics, kLatency };

/// Topics of run.mcap in the order of RunChannel.
std::vector<drivers::McapWriter::Channel> run_channels();

/// Numbers of the channels of a trajectory without velocity and covariance.
enum class TrajectoryChannel : std::uint8_t { kPose, kTransform, kPath };
/// Topics of such a trajectory in the order of TrajectoryChannel; the path is latched.
std::vector<drivers::McapWriter::Channel> trajectory_channels();

/// Pose of base_link in odom.
struct StampedPose {
  std::int64_t stamp_ns = 0;
  std::array<double, 3> position{};
  std::array<double, 4> orientation_xyzw{};
};

// Serialized messages: CDR, little-endian, with the encapsulation. The bytes replace those in `out`.
void write_odometry(const ipc::PoseRecord& record, const RunFrames& frames, std::vector<std::uint8_t>& out);
void write_pose(const StampedPose& pose, const RunFrames& frames, std::vector<std::uint8_t>& out);
void write_transform(const StampedPose& pose, const RunFrames& frames, std::vector<std::uint8_t>& out);
void write_path(std::span<const StampedPose> poses, const RunFrames& frames, std::vector<std::uint8_t>& out);
void write_scan(const CloudRecord& cloud, const RunFrames& frames, std::vector<std::uint8_t>& out);
void write_submap(const ipc::SubmapCloud& submap, const RunFrames& frames, std::vector<std::uint8_t>& out);
void write_diagnostics(const dds::DiagnosticArray& array, std::vector<std::uint8_t>& out);
void write_number(double value, std::vector<std::uint8_t>& out);

}  // namespace nilio::daemon
