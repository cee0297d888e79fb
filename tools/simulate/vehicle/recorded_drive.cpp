#include "tools/simulate/vehicle/recorded_drive.hpp"

#include "tools/common/trajectory.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <unordered_map>
#include <utility>

#include <Eigen/SparseCholesky>
#include <Eigen/SparseCore>

namespace nilio::tools::simulate {

namespace {

using core::Error;
using core::Result;
using core::SE3;
using core::Vector3;

/// 10 m in one frame of 0.1 s is faster than any road vehicle: the file has other units or another order.
constexpr double kMaxSpeedMPerS = 100.0;
constexpr double kSetOffAcceleration = 1.4;

/// Camera poses in the frame of the first one.
Result<std::vector<SE3>> read_camera_poses(const std::string& path) {
  const Result<tools::Trajectory> file = read_trajectory(path);
  if (!file) return file.error();
  if (file->format != TrajectoryFormat::kKitti) {
    return Error{path + ": is a TUM trajectory; give a KITTI pose file (12 numbers a line), or 'town'"};
  }
  if (file->poses.size() < 4) {
    return Error{path + ": holds " + std::to_string(file->poses.size()) + " poses; a drive needs at least 4"};
  }
  std::vector<SE3> poses;
  poses.reserve(file->poses.size());
  for (const Pose& pose : file->poses) poses.push_back(se3_of(pose));
  return poses;
}

/// Fails where the vehicle would be faster than kMaxSpeedMPerS.
Result<bool> check_steps(const std::vector<SE3>& poses, const RecordedDriveConfig& config) {
  for (std::size_t i = 1; i < poses.size(); ++i) {
    const double step = (poses[i].translation - poses[i - 1].translation).norm();
    if (!(step <= kMaxSpeedMPerS * config.pose_interval_s)) {
      return Error{config.pose_file + ": pose " + std::to_string(i + 1) + " is " + std::to_string(step) +
                   " m from the one before, faster than " + std::to_string(static_cast<int>(kMaxSpeedMPerS)) +
                   " m/s; check the file and --pose-interval"};
    }
  }
  return true;
}

/// `poses` smoothed by a Gaussian over neighbouring poses; the window shrinks towards the ends.
std::vector<SE3> smooth_poses(const std::vector<SE3>& poses) {
  constexpr double sigma = 2.0;
  constexpr std::ptrdiff_t half_width = 5;
  std::vector<SE3> result;
  result.reserve(poses.size());
  const auto count = static_cast<std::ptrdiff_t>(poses.size());
  for (std::ptrdiff_t i = 0; i < count; ++i) {
    const std::ptrdiff_t half = std::min({half_width, i, count - 1 - i});
    const SE3& centre = poses[static_cast<std::size_t>(i)];
    Vector3 translation = Vector3::Zero();
    Vector3 rotation = Vector3::Zero();
    double total = 0.0;
    for (std::ptrdiff_t k = -half; k <= half; ++k) {
      const SE3& other = poses[static_cast<std::size_t>(i + k)];
      const double weight = std::exp(-0.5 * static_cast<double>(k * k) / (sigma * sigma));
      translation += weight * other.translation;
      rotation += weight * core::so3_log(centre.rotation.conjugate() * other.rotation);
      total += weight;
    }
    result.push_back({(centre.rotation * core::so3_exp(rotation / total)).normalized(), translation / total});
  }
  return result;
}

/// Recorded time at each control instant: stationary, then a smooth start of time from rate 0 to 1, so that
/// the vehicle accelerates along the recorded path.
std::vector<double> recorded_times(const VehicleTrajectory& recorded, bool moving_start) {
  const double speed = recorded.state(0.0).velocity.norm();
  const double ramp_s = moving_start ? 0.0 : std::max(0.5, speed / kSetOffAcceleration);
  const double stationary_s = moving_start ? 0.0 : kStationaryTimeS;
  std::vector<double> times;
  for (std::size_t i = 0;; ++i) {
    const double t = static_cast<double>(i) * kControlIntervalS - stationary_s;
    double u = std::max(0.0, t - 0.5 * ramp_s);
    if (t <= 0.0) {
      u = 0.0;
    } else if (t < ramp_s) {
      const double x = t / ramp_s;
      u = ramp_s * (x * x * x - 0.5 * x * x * x * x);
    }
    if (u > recorded.duration_s()) return times;
    times.push_back(u);
  }
}

constexpr double kNodeSpacingM = 2.0;
/// Passes closer than this share one ground, oncoming lanes too.
constexpr double kSamePlaceM = 6.0;
/// Nodes less than 40 m of driving apart belong to one pass.
constexpr std::size_t kOwnPass = 20;
/// Weight of an even correction along the drive against equal heights at one place: bends are spread over
/// about 20 m.
constexpr double kStiffness = 100.0;

/// Poses about every kNodeSpacingM, by index.
std::vector<std::size_t> choose_nodes(const std::vector<core::SE3>& poses) {
  std::vector<std::size_t> nodes{0};
  for (std::size_t i = 1; i < poses.size(); ++i) {
    const auto moved = poses[i].translation - poses[nodes.back()].translation;
    if (moved.head<2>().norm() >= kNodeSpacingM) nodes.push_back(i);
  }
  return nodes;
}

struct Pair {
  std::size_t earlier;
  std::size_t later;
};

/// Pairs of nodes of different passes at the same place.
std::vector<Pair> find_pairs(const std::vector<core::SE3>& poses, const std::vector<std::size_t>& nodes) {
  const auto bucket = [](const core::Vector3& p, int dx, int dy) {
    const auto x = static_cast<std::int64_t>(std::floor(p.x() / kSamePlaceM)) + dx;
    const auto y = static_cast<std::int64_t>(std::floor(p.y() / kSamePlaceM)) + dy;
    return x * 4'000'037 + y;
  };
  std::unordered_map<std::int64_t, std::vector<std::size_t>> buckets;
  std::vector<Pair> pairs;
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    const core::Vector3& here = poses[nodes[i]].translation;
    for (int k = 0; k < 9; ++k) {
      const auto found = buckets.find(bucket(here, k / 3 - 1, k % 3 - 1));
      if (found == buckets.end()) continue;
      for (const std::size_t j : found->second) {
        const double gap = (poses[nodes[j]].translation - here).head<2>().norm();
        if (j + kOwnPass < i && gap < kSamePlaceM) pairs.push_back({j, i});
      }
    }
    buckets[bucket(here, 0, 0)].push_back(i);
  }
  return pairs;
}

/// Corrections of the nodes' heights.
Eigen::VectorXd solve_corrections(const std::vector<core::SE3>& poses, const std::vector<std::size_t>& nodes,
                                  const std::vector<Pair>& pairs) {
  std::vector<Eigen::Triplet<double>> entries;
  Eigen::VectorXd right = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(nodes.size()));
  const auto connect = [&](std::size_t a, std::size_t b, double weight, double wanted_difference) {
    const auto i = static_cast<int>(a);
    const auto j = static_cast<int>(b);
    entries.emplace_back(i, i, weight);
    entries.emplace_back(j, j, weight);
    entries.emplace_back(i, j, -weight);
    entries.emplace_back(j, i, -weight);
    right[i] -= weight * wanted_difference;
    right[j] += weight * wanted_difference;
  };
  entries.emplace_back(0, 0, 1.0);
  for (std::size_t i = 1; i < nodes.size(); ++i) connect(i - 1, i, kStiffness, 0.0);
  for (const Pair& pair : pairs) {
    const double rise = poses[nodes[pair.later]].translation.z() - poses[nodes[pair.earlier]].translation.z();
    connect(pair.earlier, pair.later, 1.0, -rise);
  }
  Eigen::SparseMatrix<double> normal(right.size(), right.size());
  normal.setFromTriplets(entries.begin(), entries.end());
  return Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>>(normal).solve(right);
}

}  // namespace

void close_heights(std::vector<core::SE3>& poses) {
  const std::vector<std::size_t> nodes = choose_nodes(poses);
  const std::vector<Pair> pairs = find_pairs(poses, nodes);
  if (pairs.empty()) return;
  const Eigen::VectorXd corrections = solve_corrections(poses, nodes, pairs);
  for (std::size_t n = 0; n < nodes.size(); ++n) {
    const bool last = n + 1 == nodes.size();
    const std::size_t end = last ? poses.size() : nodes[n + 1];
    const double from = corrections[static_cast<Eigen::Index>(n)];
    const double to = corrections[static_cast<Eigen::Index>(last ? n : n + 1)];
    for (std::size_t i = nodes[n]; i < end; ++i) {
      const double share = static_cast<double>(i - nodes[n]) / static_cast<double>(end - nodes[n]);
      poses[i].translation.z() += std::lerp(from, to, share);
    }
  }
}

SE3 default_kitti_calibration() {
  Eigen::Matrix<double, 3, 4> numbers;
  numbers << 4.276802385584e-04, -9.999672484946e-01, -8.084491683471e-03, -1.198459927713e-02,  //
      -7.210626507497e-03, 8.081198471645e-03, -9.999413164504e-01, -5.403984729748e-02,         //
      9.999738645903e-01, 4.859485810390e-04, -7.206933692422e-03, -2.921968648686e-01;
  return core::se3_from_matrix(numbers);
}

Result<std::vector<SE3>> make_recorded_drive(const RecordedDriveConfig& config) {
  const Result<std::vector<SE3>> camera_poses = read_camera_poses(config.pose_file);
  if (!camera_poses) return camera_poses.error();
  SE3 T_camera_lidar = default_kitti_calibration();
  if (!config.calibration_file.empty()) {
    const Result<Pose> calibration = read_kitti_calibration(config.calibration_file);
    if (!calibration) return calibration.error();
    T_camera_lidar = se3_of(*calibration);
  }
  const SE3 T_camera_base = T_camera_lidar * config.T_base_lidar.inverse();
  const SE3 T_base_world = (camera_poses->front() * T_camera_base).inverse();
  std::vector<SE3> base_poses;
  base_poses.reserve(camera_poses->size());
  for (const SE3& camera : *camera_poses) base_poses.push_back(T_base_world * camera * T_camera_base);
  const Result<bool> steps = check_steps(base_poses, config);
  if (!steps) return steps.error();
  close_heights(base_poses);
  const VehicleTrajectory recorded(smooth_poses(base_poses), config.pose_interval_s);
  std::vector<SE3> poses;
  for (const double time : recorded_times(recorded, config.moving_start))
    poses.push_back(recorded.pose(time));
  if (poses.size() < 2) return Error{config.pose_file + ": the drive is shorter than 0.1 s"};
  return cut_drive(std::move(poses), kControlIntervalS, config.extent);
}

}  // namespace nilio::tools::simulate
