#include "daemon/config/convert.hpp"

#include "nilio/core/units.hpp"

#include <cmath>
#include <optional>
#include <string>

namespace nilio::daemon {

namespace {

std::optional<drivers::ReturnMode> return_mode(const std::string& name) {
  if (name == "single") return drivers::ReturnMode::kSingle;
  if (name == "dual") return drivers::ReturnMode::kDual;
  if (name == "dual_confidence") return drivers::ReturnMode::kDualConfidence;
  return std::nullopt;
}

}  // namespace

core::SE3 to_transform(const ExtrinsicConfig& extrinsic) {
  const auto& t = extrinsic.translation;
  const auto& rpy = extrinsic.rotation_rpy_deg;
  const Eigen::Quaterniond rotation = core::so3_exp(rpy[2] * kRadiansPerDegree * core::Vector3::UnitZ()) *
                                      core::so3_exp(rpy[1] * kRadiansPerDegree * core::Vector3::UnitY()) *
                                      core::so3_exp(rpy[0] * kRadiansPerDegree * core::Vector3::UnitX());
  return {rotation.normalized(), core::Vector3(t[0], t[1], t[2])};
}

float elevation_correction_rad(const LidarConfig& lidar) {
  return static_cast<float>(lidar.elevation_correction_deg * kRadiansPerDegree);
}

core::OdometryConfig odometry_config(const Config& config) {
  const OdometrySection& c = config.odometry;
  core::OdometryConfig result;
  result.T_base_lidar = to_transform(config.lidar.extrinsic);
  result.T_base_imu = to_transform(config.imu.extrinsic);
  result.threads = c.threads;
  result.elevation_correction_rad = elevation_correction_rad(config.lidar);
  result.calibrate_beams = c.calibrate_beams;
  result.min_range_m = static_cast<float>(config.lidar.min_range_m);
  result.max_range_m = static_cast<float>(config.lidar.max_range_m);
  result.filter_voxel_m = static_cast<float>(c.filter_voxel_m);
  result.scan_points = static_cast<std::size_t>(c.scan_points);
  result.registration_points = static_cast<std::size_t>(c.registration_points);
  result.plane_voxel_m = c.plane_voxel_m;
  result.coarse_voxel_m = c.coarse_voxel_m;
  result.map_radius_m = c.map_radius_m;
  result.map_capacity = static_cast<std::size_t>(c.map_capacity);
  // The schema accepts registered method names only.
  if (const auto method = core::registration_method_of(c.registration)) result.registration = *method;
  result.coarse = c.coarse == "always" ? core::CoarsePolicy::kAlways : core::CoarsePolicy::kAuto;
  result.max_passes = c.max_passes;
  result.max_fine_iterations = c.max_fine_iterations;
  result.max_coarse_iterations = c.max_coarse_iterations;
  result.max_imu_gap = core::Duration::from_milliseconds(c.max_imu_gap_ms);
  return result;
}

ipc::ImuPoseConfig imu_pose_config(const Config& config) {
  const ImuPoseSection& pose = config.publisher.imu_pose;
  ipc::ImuPoseConfig result;
  result.propagation.T_base_imu = to_transform(config.imu.extrinsic);
  result.propagation.max_gap = core::Duration::from_milliseconds(config.odometry.max_imu_gap_ms);
  result.propagation.max_age = core::Duration::from_seconds(pose.max_age_s);
  result.slew.max_slew_m_s = pose.max_slew_m_s;
  result.slew.max_slew_rad_s = pose.max_slew_deg_s * kRadiansPerDegree;
  result.slew.settle = core::Duration::from_milliseconds(pose.settle_ms);
  result.slew.jump_m = pose.jump_m;
  result.slew.jump_rad = pose.jump_deg * kRadiansPerDegree;
  result.max_rate_hz = config.publisher.imu_rate_max_hz;
  return result;
}

core::BudgetConfig budget_config(const OdometrySection& odometry, bool live) {
  const auto mode = odometry.budget == "wall"           ? core::BudgetMode::kWall
                    : odometry.budget == "ops"          ? core::BudgetMode::kOps
                    : odometry.budget == "off" || !live ? core::BudgetMode::kOff
                                                        : core::BudgetMode::kWall;
  return {mode, core::Duration::from_milliseconds(odometry.budget_ms)};
}

drivers::ScanAssemblerConfig assembler_config(const LidarConfig& lidar) {
  drivers::ScanAssemblerConfig result;
  result.time_source = lidar.time_source == "sensor" ? drivers::TimeSource::kSensor
                       : lidar.time_source == "host" ? drivers::TimeSource::kHost
                                                     : drivers::TimeSource::kAuto;
  result.cut_azimuth_deg = lidar.cut_azimuth_deg;
  result.min_range_m = lidar.min_range_m;
  result.max_range_m = lidar.max_range_m;
  result.min_coverage = lidar.min_coverage;
  result.stamp_offset_ns = std::llround(lidar.stamp_offset_us * 1e3);
  result.return_mode = return_mode(lidar.return_mode);
  result.returns = lidar.returns == "strongest" ? drivers::ReturnChoice::kStrongest
                   : lidar.returns == "last"    ? drivers::ReturnChoice::kLast
                                                : drivers::ReturnChoice::kAll;
  return result;
}

}  // namespace nilio::daemon
