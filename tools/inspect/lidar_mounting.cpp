#include "tools/inspect/lidar_mounting.hpp"

#include "nilio/core/units.hpp"

#include "daemon/input/input.hpp"
#include "tools/common/progress.hpp"
#include "tools/common/statistics.hpp"
#include "tools/inspect/drive_replay.hpp"
#include "tools/inspect/imu_calibration/imu_calibration.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <random>
#include <utility>

#include <Eigen/Dense>

namespace nilio::tools::inspect {

namespace {

using core::SE3;
using core::Vector3;

/// Points are kept of a scan per metre, or per second at rest, of this many.
constexpr double kScanEveryM = 1.0;
constexpr double kScanEveryS = 1.0;
constexpr std::size_t kMaximumScans = 600;
/// Ground beyond follows the terrain rather than the vehicle.
constexpr double kGroundRangeM = 20.0;
/// Limits of a mounting: tilt, and height above ground.
constexpr double kMaximumTilt = 40.0 * kRadiansPerDegree;
constexpr double kMinimumHeightM = 0.2;
constexpr double kMaximumHeightM = 6.0;
/// RANSAC: planes tried per scan, and the half thickness of the ground.
constexpr int kTrials = 200;
constexpr double kCoarseThicknessM = 0.10;
/// Lane in front of and behind the vehicle: half its width and thickness.
constexpr double kLaneHalfWidthM = 2.0;
constexpr double kFineThicknessM = 0.06;
constexpr std::size_t kMinimumGroundPoints = 30;
/// A stretch is straight if the vehicle turns by less over its length.
constexpr double kStraightAngle = 1.0 * kRadiansPerDegree;

/// z = height + along * x + across * y + bend * x^2, in a frame with z up.
using Surface = Eigen::Vector4d;

/// Mean of the middle half: as robust as is needed, and more precise than the median.
double middle_mean(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const std::size_t cut = values.size() / 4;
  double sum = 0.0;
  for (std::size_t i = cut; i < values.size() - cut; ++i) sum += values[i];
  return sum / static_cast<double>(values.size() - 2 * cut);
}

/// Of a normal distribution with the same median absolute deviation.
double robust_deviation(const std::vector<double>& values) {
  const double centre = median(values);
  std::vector<double> distances;
  for (const double value : values) distances.push_back(std::abs(value - centre));
  return 1.4826 * median(std::move(distances));
}

/// Plane with the most points of a scan that can be ground: its unit normal (upwards) and height of the
/// sensor above it.
struct Plane {
  Vector3 normal;
  double height_m = 0.0;
};

std::optional<Plane> find_ground(const std::vector<Eigen::Vector3f>& points, std::uint64_t seed) {
  std::vector<Vector3> near;
  for (const Eigen::Vector3f& point : points) {
    if (static_cast<double>(point.norm()) < kGroundRangeM) near.push_back(point.cast<double>());
  }
  if (near.size() < kMinimumGroundPoints) return std::nullopt;
  std::mt19937_64 random(seed);
  std::optional<Plane> best;
  std::size_t most = kMinimumGroundPoints;
  for (int trial = 0; trial < kTrials; ++trial) {
    const Vector3& a = near[random() % near.size()];
    const Vector3& b = near[random() % near.size()];
    const Vector3& c = near[random() % near.size()];
    Vector3 normal = (b - a).cross(c - a);
    if (normal.norm() < 1.0) continue;
    normal.normalize();
    if (normal.z() < 0.0) normal = -normal;
    const double height = -normal.dot(a);
    if (normal.z() < std::cos(kMaximumTilt) || height < kMinimumHeightM || height > kMaximumHeightM) continue;
    const auto count =
        static_cast<std::size_t>(std::count_if(near.begin(), near.end(), [&](const Vector3& p) {
          return std::abs(normal.dot(p) + height) < kCoarseThicknessM;
        }));
    if (count <= most) continue;
    most = count;
    best = Plane{normal, height};
  }
  return best;
}

/// Rotation to a frame with z along `up` and x along `forward`, as far as it is across `up`.
core::Matrix3 upright(const Vector3& up, const Vector3& forward) {
  const Vector3 x = (forward - forward.dot(up) * up).normalized();
  core::Matrix3 rotation;
  rotation << x.transpose(), up.cross(x).transpose(), up.transpose();
  return rotation;
}

/// Fits the lane's surface. A bend keeps hills and hollows out of the height, if there is ground both in
/// front and behind.
std::optional<Surface> fit_lane(const std::vector<Eigen::Vector3f>& points,
                                const core::Matrix3& R_level_lidar, double height_m) {
  std::vector<Vector3> lane;
  for (const Eigen::Vector3f& point : points) {
    const Vector3 p = R_level_lidar * point.cast<double>();
    if (std::abs(p.y()) < kLaneHalfWidthM && std::abs(p.x()) < kGroundRangeM) lane.push_back(p);
  }
  Surface surface(-height_m, 0.0, 0.0, 0.0);
  // The first estimate may be 3 degrees off: thick at first.
  for (const double thickness :
       {4.0 * kFineThicknessM, 2.0 * kFineThicknessM, kFineThicknessM, kFineThicknessM}) {
    Eigen::Matrix4d A = Eigen::Matrix4d::Zero();
    Eigen::Vector4d b = Eigen::Vector4d::Zero();
    std::array<std::size_t, 2> side{};
    for (const Vector3& p : lane) {
      const Eigen::Vector4d row(1.0, p.x(), p.y(), p.x() * p.x());
      if (std::abs(p.z() - row.dot(surface)) > thickness) continue;
      A += row * row.transpose();
      b += row * p.z();
      ++side[p.x() > 0.0 ? 0 : 1];
    }
    if (side[0] + side[1] < kMinimumGroundPoints) return std::nullopt;
    const bool both = std::min(side[0], side[1]) >= kMinimumGroundPoints / 3;
    surface.setZero();
    if (both) {
      surface = A.ldlt().solve(b);
    } else {
      surface.head<3>() = A.topLeftCorner<3, 3>().ldlt().solve(b.head<3>());
    }
  }
  return surface;
}

/// Direction of travel in the LiDAR's frame, from stretches without a turn; those driven against it are
/// turned round.
struct Heading {
  Vector3 forward = Vector3::UnitX();
  std::vector<Vector3> directions;
  std::size_t reversed = 0;
};

Heading find_heading(const std::vector<MountingScan>& scans) {
  Heading heading;
  std::size_t begin = 0;
  for (std::size_t i = 1; i < scans.size(); ++i) {
    if (scans[i].predicted) {
      begin = i + 1;
      continue;
    }
    if (begin >= i) continue;
    const SE3 T = scans[begin].T_odom_lidar.inverse() * scans[i].T_odom_lidar;
    if (T.translation.norm() < kStretchM) continue;
    begin = i;
    const Vector3 turn = core::so3_log(T.rotation);
    if (turn.norm() > kStraightAngle) continue;
    // In the frame halfway between the two.
    heading.directions.push_back((core::so3_exp(-0.5 * turn) * T.translation).normalized());
  }
  if (heading.directions.empty()) return heading;
  const Vector3 first = heading.directions.front();
  const auto against =
      static_cast<std::size_t>(std::count_if(heading.directions.begin(), heading.directions.end(),
                                             [&](const Vector3& d) { return d.dot(first) < 0.0; }));
  const bool first_is_reversed = 2 * against > heading.directions.size();
  heading.reversed = first_is_reversed ? heading.directions.size() - against : against;
  Vector3 sum = Vector3::Zero();
  for (Vector3& direction : heading.directions) {
    if ((direction.dot(first) < 0.0) != first_is_reversed) direction = -direction;
    sum += direction;
  }
  heading.forward = sum.normalized();
  return heading;
}

/// Ground over all scans, coarsely: median of the normals and of the heights.
std::optional<Plane> find_common_ground(const std::vector<MountingScan>& scans) {
  std::array<std::vector<double>, 4> found;
  for (std::size_t i = 0; i < scans.size(); ++i) {
    const auto plane = find_ground(scans[i].points, i);
    if (!plane) continue;
    for (int axis = 0; axis < 3; ++axis) found[static_cast<std::size_t>(axis)].push_back(plane->normal[axis]);
    found[3].push_back(plane->height_m);
  }
  if (found[0].empty()) return std::nullopt;
  const Vector3 normal(median(found[0]), median(found[1]), median(found[2]));
  return Plane{normal.normalized(), median(found[3])};
}

}  // namespace

bool LidarMounting::is_yaw_observed() const {
  return ground_scans > 0 && straight_m >= kMinimumStraightM && !is_direction_ambiguous();
}

bool LidarMounting::is_direction_ambiguous() const { return 3.0 * reversed_m > straight_m; }

LidarMounting estimate_lidar_mounting(const std::vector<MountingScan>& scans) {
  LidarMounting mounting;
  const std::optional<Plane> ground = find_common_ground(scans);
  if (!ground) return mounting;
  const Heading heading = find_heading(scans);
  mounting.straight_m = kStretchM * static_cast<double>(heading.directions.size());
  mounting.reversed_m = kStretchM * static_cast<double>(heading.reversed);
  // The lane is the same in both directions.
  const bool knows_axis = mounting.straight_m >= kMinimumStraightM;
  const bool knows_heading = knows_axis && !mounting.is_direction_ambiguous();
  const core::Matrix3 R_level_lidar =
      upright(ground->normal, knows_axis ? heading.forward : Vector3::UnitX());
  std::array<std::vector<double>, 3> fitted;
  for (const MountingScan& scan : scans) {
    const auto surface = fit_lane(scan.points, R_level_lidar, ground->height_m);
    if (!surface) continue;
    for (int k = 0; k < 3; ++k) fitted[static_cast<std::size_t>(k)].push_back((*surface)[k]);
  }
  mounting.ground_scans = fitted[0].size();
  if (mounting.ground_scans == 0) return mounting;
  const Vector3 up_level = Vector3(-middle_mean(fitted[1]), -middle_mean(fitted[2]), 1.0).normalized();
  mounting.height_m = -middle_mean(fitted[0]) * up_level.z();
  mounting.height_deviation_m = robust_deviation(fitted[0]);
  mounting.slope_deviation_deg =
      std::hypot(robust_deviation(fitted[1]), robust_deviation(fitted[2])) * kDegreesPerRadian;
  const Vector3 up = R_level_lidar.transpose() * up_level;
  core::Matrix3 R_base_lidar = upright(up, knows_heading ? heading.forward : Vector3::UnitX());
  if (knows_heading) {
    std::vector<double> yaws;
    for (const Vector3& direction : heading.directions) {
      const Vector3 in_base = R_base_lidar * direction;
      yaws.push_back(std::atan2(in_base.y(), in_base.x()));
    }
    mounting.yaw_deviation_deg = robust_deviation(yaws) * kDegreesPerRadian;
    R_base_lidar = Eigen::AngleAxisd(-middle_mean(yaws), Vector3::UnitZ()) * R_base_lidar;
  }
  mounting.rotation_rpy_deg = roll_pitch_yaw(R_base_lidar) * kDegreesPerRadian;
  return mounting;
}

core::Result<LidarMounting> find_lidar_mounting(const daemon::ReplayFiles& files, daemon::Config config,
                                                double seconds) {
  config.lidar.extrinsic = {};
  // Its own mounting is not known yet.
  config.imu.enabled = false;
  core::Result<daemon::Input> input = daemon::open_replay(files, config);
  if (!input) return input.error();
  std::vector<MountingScan> scans;
  std::size_t kept = 0;
  std::optional<std::pair<core::Time, Vector3>> last_kept;
  core::Time first;
  Progress progress("finding the LiDAR's mounting", static_cast<std::uint64_t>(seconds));
  const auto observe = [&](const core::Scan&, const core::OdometryResult& result,
                           const core::Odometry& odometry) {
    if (scans.empty()) first = result.scan_end;
    progress.update(static_cast<std::uint64_t>((result.scan_end - first).seconds()));
    scans.push_back({result.T_odom_base, result.predicted, {}});
    const Vector3& position = result.T_odom_base.translation;
    const bool due = !last_kept || (position - last_kept->second).norm() >= kScanEveryM ||
                     (result.scan_end - last_kept->first).seconds() >= kScanEveryS;
    if (result.predicted || !due || kept == kMaximumScans) return;
    ++kept;
    last_kept = {result.scan_end, position};
    scans.back().points = odometry.deskewed_points();
  };
  const core::Result<bool> done =
      replay_drive(config, std::move(input).value(), {seconds, observe, [](daemon::Pipeline& pipeline) {
                                                        while (pipeline.poses().try_pop()) {
                                                        }
                                                      }});
  if (!done) return done.error();
  return estimate_lidar_mounting(scans);
}

}  // namespace nilio::tools::inspect
