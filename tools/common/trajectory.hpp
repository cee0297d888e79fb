#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/se3.hpp"
#include "nilio/core/time.hpp"

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <Eigen/Geometry>

namespace nilio::tools {

/// Pose of a body in a fixed frame, T_world_body, metres. A matrix as the files have it: metrics of published
/// trajectories agree with other tools to the last digit only when their rotations are not normalised first.
using Pose = Eigen::Isometry3d;

/// The same with its rotation normalised.
core::SE3 se3_of(const Pose& pose);

enum class TrajectoryFormat {
  kTum,    ///< "seconds x y z qx qy qz qw" per line
  kKitti,  ///< the first three rows of the 4x4 matrix per line, no time
};

struct Trajectory {
  TrajectoryFormat format = TrajectoryFormat::kTum;
  /// As given by the user, for messages.
  std::string path;
  /// As long as `poses` and strictly increasing for kTum, empty for kKitti.
  std::vector<core::Time> stamps;
  std::vector<Pose> poses;
};

/// Reads a TUM or KITTI file, distinguished by the number of columns of the first line. Blank lines and lines
/// that begin with '#' are skipped. Errors name file and line: wrong number of columns, not a number, not
/// finite, not a rotation, time that does not increase, no pose at all.
core::Result<Trajectory> read_trajectory(const std::string& path);

/// One line per pose in the trajectory's own format; TUM with nanoseconds.
std::string trajectory_text(const Trajectory& trajectory);
/// The same as a file. Fails when the file cannot be
/// written.
core::Result<std::size_t> write_trajectory(const Trajectory& trajectory, const std::string& path);

/// T_camera_lidar from the line "Tr:" (12 numbers) of a KITTI odometry calib.txt.
core::Result<Pose> read_kitti_calibration(const std::string& path);

/// Pose at `stamp` between its two neighbours: linear in position, spherical in rotation. Empty outside the
/// trajectory or when the neighbours are more than `max_gap` apart.
std::optional<Pose> interpolate_pose(const Trajectory& trajectory, core::Time stamp, core::Duration max_gap);

/// Sum of the distances between consecutive poses, metres.
double path_length(std::span<const Pose> poses);

/// Length of the path up to each pose, metres, beginning with 0.
std::vector<double> path_lengths(std::span<const Pose> poses);

/// Numbers of a line separated by blanks; empty when one is not a finite number.
std::optional<std::vector<double>> parse_numbers(std::string_view line);

/// Decimal seconds to the nanosecond; empty for what is no time until 2262.
std::optional<core::Time> parse_stamp(std::string_view seconds);

/// "path:line: problem", for error messages.
std::string line_error(const std::string& path, std::size_t line, const std::string& problem);

}  // namespace nilio::tools
