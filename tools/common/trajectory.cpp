#include "tools/common/trajectory.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <system_error>

namespace nilio::tools {

core::SE3 se3_of(const Pose& pose) { return core::se3_from_matrix(pose.matrix().topRows<3>()); }

namespace {

constexpr std::size_t kTumColumns = 8;
constexpr std::size_t kKittiColumns = 12;
// Files are printed with six digits or more: a larger deviation is no rounding but a wrong column order.
constexpr double kRotationTolerance = 0.02;
// The year 2262, where nanoseconds in 64 bits end.
constexpr double kMaxSeconds = 9.2e9;

std::vector<std::string_view> split(std::string_view line) {
  std::vector<std::string_view> words;
  constexpr std::string_view blanks = " \t\r";
  std::size_t begin = line.find_first_not_of(blanks);
  while (begin != std::string_view::npos) {
    const std::size_t end = std::min(line.find_first_of(blanks, begin), line.size());
    words.push_back(line.substr(begin, end - begin));
    begin = line.find_first_not_of(blanks, end);
  }
  return words;
}

template <class Number>
std::optional<Number> parse_number(std::string_view word) {
  if (word.starts_with('+')) word.remove_prefix(1);
  Number value = 0;
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (error != std::errc() || end != word.data() + word.size() || !std::isfinite(value)) return std::nullopt;
  return value;
}

Pose pose_from_rows(std::span<const double> numbers) {
  Pose pose = Pose::Identity();
  pose.matrix().topRows<3>() = Eigen::Map<const Eigen::Matrix<double, 3, 4, Eigen::RowMajor>>(numbers.data());
  return pose;
}

bool is_rotation(const Eigen::Matrix3d& matrix) {
  return (matrix * matrix.transpose() - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff() <
             kRotationTolerance &&
         matrix.determinant() > 0.0;
}

/// Adds a line. Returns an error text, or an empty one.
std::string add_tum_line(const std::vector<std::string_view>& words, std::span<const double> numbers,
                         Trajectory& trajectory) {
  const auto stamp = parse_stamp(words[0]);
  if (!stamp) return "the time is out of range";
  if (!trajectory.stamps.empty() && *stamp <= trajectory.stamps.back()) {
    return "the time does not increase - sort the file by its first column and remove repeated lines";
  }
  Eigen::Quaterniond rotation(numbers[7], numbers[4], numbers[5], numbers[6]);
  if (std::abs(rotation.norm() - 1.0) > kRotationTolerance) {
    return "columns 5 to 8 are no unit quaternion (order: qx qy qz qw)";
  }
  rotation.normalize();
  Pose pose = Pose::Identity();
  pose.linear() = rotation.toRotationMatrix();
  pose.translation() << numbers[1], numbers[2], numbers[3];
  trajectory.stamps.push_back(*stamp);
  trajectory.poses.push_back(pose);
  return {};
}

std::string add_kitti_line(std::span<const double> numbers, Trajectory& trajectory) {
  const Pose pose = pose_from_rows(numbers);
  if (!is_rotation(pose.linear())) {
    return "columns 1-3, 5-7 and 9-11 are no rotation matrix (order: rows of [R|t])";
  }
  trajectory.poses.push_back(pose);
  return {};
}

std::string add_line(std::string_view line, Trajectory& trajectory) {
  const std::vector<std::string_view> words = split(line);
  if (words.size() != kTumColumns && words.size() != kKittiColumns) {
    return std::to_string(words.size()) +
           " columns; a TUM line has 8 (time x y z qx qy qz qw), a KITTI line 12 (rows of [R|t])";
  }
  const auto format = words.size() == kTumColumns ? TrajectoryFormat::kTum : TrajectoryFormat::kKitti;
  if (trajectory.poses.empty()) trajectory.format = format;
  if (trajectory.format != format) {
    return std::to_string(words.size()) + " columns, where the lines before have " +
           std::to_string(trajectory.format == TrajectoryFormat::kTum ? kTumColumns : kKittiColumns);
  }
  const auto numbers = parse_numbers(line);
  if (!numbers) return "not every column is a finite number";
  return format == TrajectoryFormat::kTum ? add_tum_line(words, *numbers, trajectory)
                                          : add_kitti_line(*numbers, trajectory);
}

}  // namespace

std::optional<std::vector<double>> parse_numbers(std::string_view line) {
  std::vector<double> numbers;
  for (const std::string_view word : split(line)) {
    const auto number = parse_number<double>(word);
    if (!number) return std::nullopt;
    numbers.push_back(*number);
  }
  return numbers;
}

std::string line_error(const std::string& path, std::size_t line, const std::string& problem) {
  std::string message = path;
  message.append(":").append(std::to_string(line)).append(": ").append(problem);
  return message;
}

core::Result<Trajectory> read_trajectory(const std::string& path) {
  std::ifstream file(path);
  if (!file) return core::Error{path + ": cannot be opened - give a TUM or KITTI trajectory file"};
  Trajectory trajectory;
  trajectory.path = path;
  std::string line;
  for (std::size_t number = 1; std::getline(file, line); ++number) {
    const std::size_t begin = line.find_first_not_of(" \t\r");
    if (begin == std::string::npos || line[begin] == '#') continue;
    const std::string problem = add_line(line, trajectory);
    if (!problem.empty()) return core::Error{line_error(path, number, problem)};
  }
  if (file.bad()) return core::Error{path + ": reading failed"};
  if (trajectory.poses.empty()) {
    return core::Error{path + ": contains no pose - give a TUM or KITTI trajectory file"};
  }
  return trajectory;
}

std::optional<core::Time> parse_stamp(std::string_view seconds) {
  // 53 bits leave 240 ns of a stamp of this decade: the stamp is read with the 64 bits of long double.
  const auto value = parse_number<long double>(seconds);
  if (!value || std::abs(static_cast<double>(*value)) > kMaxSeconds) return std::nullopt;
  return core::Time{std::llround(*value * 1e9L)};
}

std::string trajectory_text(const Trajectory& trajectory) {
  std::string lines;
  std::array<char, 512> text{};
  for (std::size_t i = 0; i < trajectory.poses.size(); ++i) {
    const Pose& pose = trajectory.poses[i];
    const Eigen::Vector3d t = pose.translation();
    if (trajectory.format == TrajectoryFormat::kTum) {
      const std::int64_t ns = trajectory.stamps[i].ns;
      const Eigen::Quaterniond q = Eigen::Quaterniond(pose.linear()).normalized();
      std::snprintf(text.data(), text.size(), "%s%lld.%09lld %.9f %.9f %.9f %.12f %.12f %.12f %.12f\n",
                    ns < 0 ? "-" : "", std::abs(ns / 1'000'000'000LL), std::abs(ns % 1'000'000'000LL), t.x(),
                    t.y(), t.z(), q.x(), q.y(), q.z(), q.w());
      lines += text.data();
    } else {
      for (int k = 0; k < 12; ++k) {
        std::snprintf(text.data(), text.size(), "%.12e%c", pose.matrix()(k / 4, k % 4), k == 11 ? '\n' : ' ');
        lines += text.data();
      }
    }
  }
  return lines;
}

core::Result<std::size_t> write_trajectory(const Trajectory& trajectory, const std::string& path) {
  std::ofstream file(path);
  file << trajectory_text(trajectory);
  file.close();
  if (!file) return core::Error{path + ": could not be written - check the folder and the space on the disk"};
  return trajectory.poses.size();
}

core::Result<Pose> read_kitti_calibration(const std::string& path) {
  std::ifstream file(path);
  if (!file) return core::Error{path + ": cannot be opened - give the calib.txt of the KITTI sequence"};
  std::string line;
  for (std::size_t number = 1; std::getline(file, line); ++number) {
    if (!line.starts_with("Tr:") && !line.starts_with("Tr ")) continue;
    const auto numbers = parse_numbers(std::string_view(line).substr(3));
    if (!numbers || numbers->size() != kKittiColumns || !is_rotation(pose_from_rows(*numbers).linear())) {
      return core::Error{path + ":" + std::to_string(number) +
                         ": \"Tr:\" needs the 12 numbers of a rigid transform"};
    }
    return pose_from_rows(*numbers);
  }
  return core::Error{
      path + ": has no line \"Tr:\" (LiDAR to camera) - give the calib.txt of a KITTI odometry sequence"};
}

std::optional<Pose> interpolate_pose(const Trajectory& trajectory, core::Time stamp, core::Duration max_gap) {
  const auto& stamps = trajectory.stamps;
  const auto next = std::lower_bound(stamps.begin(), stamps.end(), stamp);
  if (next == stamps.end()) return std::nullopt;
  const auto j = static_cast<std::size_t>(next - stamps.begin());
  if (*next == stamp) return trajectory.poses[j];
  if (j == 0 || stamps[j] - stamps[j - 1] > max_gap) return std::nullopt;
  const Pose& before = trajectory.poses[j - 1];
  const Pose& after = trajectory.poses[j];
  const double share =
      static_cast<double>((stamp - stamps[j - 1]).ns) / static_cast<double>((stamps[j] - stamps[j - 1]).ns);
  const Eigen::Quaterniond q_before(before.linear());
  Pose pose = Pose::Identity();
  pose.linear() = q_before.slerp(share, Eigen::Quaterniond(after.linear())).normalized().toRotationMatrix();
  pose.translation() = (1.0 - share) * before.translation() + share * after.translation();
  return pose;
}

std::vector<double> path_lengths(std::span<const Pose> poses) {
  std::vector<double> lengths(poses.size(), 0.0);
  for (std::size_t i = 1; i < poses.size(); ++i) {
    lengths[i] = lengths[i - 1] + (poses[i].translation() - poses[i - 1].translation()).norm();
  }
  return lengths;
}

double path_length(std::span<const Pose> poses) { return poses.empty() ? 0.0 : path_lengths(poses).back(); }

}  // namespace nilio::tools
