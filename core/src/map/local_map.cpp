#include "core/src/odometry_impl.hpp"
#include "core/src/registration/gauss_newton.hpp"
#include "core/src/thread_sanitizer.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include <tbb/parallel_invoke.h>

namespace nilio::core {

namespace {

// Distance at which two neighbouring beams meet a wall in one plane voxel, as 16 beams require.
constexpr double kPlaneReachMetres = 45.0;
constexpr double kMinPlaneVoxelMetres = 1.0;
constexpr double kMaxPlaneVoxelMetres = 2.0;
// Minimum number of points for which a second thread pays.
constexpr std::size_t kMinSharedPoints = 8000;
// Below both limits the vehicle is stationary and nothing is inserted: noise would thicken planes for ever.
constexpr double kStationarySpeed = 0.05;
constexpr double kStationaryTurnRate = 0.01;
// Minimum displacement since the last insertion: noise alone can exceed the speed limits above.
constexpr double kStationaryMetres = 0.02;
constexpr double kStationaryRadians = 0.002;
// Minimum number of points of a first map.
constexpr std::size_t kMinStartPoints = 50;
constexpr double kStillForceDeviation = 0.5;

}  // namespace

double plane_voxel_for(const OdometryConfig& config, float beam_spacing_rad) {
  if (config.plane_voxel_m > 0.0) return config.plane_voxel_m;
  return std::clamp(kPlaneReachMetres * static_cast<double>(beam_spacing_rad), kMinPlaneVoxelMetres,
                    kMaxPlaneVoxelMetres);
}

void Odometry::State::filter_points(const Scan& scan, OdometryResult& result) {
  is_initializing_map = scans < kInitialScans;
  // Methods that register against points need all of them.
  const std::size_t most_points = method.needs_points ? scan.points.size() : config.scan_points;
  scan_points = budget.choose_scan_points(std::min(most_points, scan.points.size()));
  const float share = scans == 0 ? kFirstVoxelShare : is_initializing_map ? kInitialVoxelShare : 1.0F;
  const ScanFilterConfig filter_config{config.min_range_m, config.max_range_m, config.filter_voxel_m * share,
                                       config.elevation_correction_rad, scan_points};
  filter_scan(scan, filter_config, config.T_base_lidar, beam_calibration, filter, sweep);
  motion_compensated = scan.motion_compensated;
  if (motion_compensated) {
    for (SweepPoint& point : sweep) point.time_s = 0.0F;
  }
  result.points = static_cast<std::uint32_t>(scan.points.size());
  result.points_filtered = static_cast<std::uint32_t>(sweep.size());
}

void Odometry::State::align_with_gravity(const Scan& scan) {
  const ImuStatistics statistics = imu_statistics(imu, scan.start, scan.end);
  if (statistics.count < 2 || statistics.acceleration_deviation > kStillForceDeviation) return;
  if (!is_gravity_plausible(statistics.mean_acceleration)) return;
  T_odom_map.rotation = Eigen::Quaterniond::FromTwoVectors(statistics.mean_acceleration, Vector3::UnitZ());
}

bool Odometry::State::restart_is_due() const {
  const bool has_not_begun = failures > 0 && scans < kInitialScans;
  const bool is_elsewhere =
      failures >= kRestartAfterFailures || relocalization_attempts >= kRestartAfterSearches;
  return (has_not_begun || is_elsewhere) && sweep.size() >= kMinStartPoints;
}

/// Resets the map at the predicted pose. The motion goes on where the IMU measured it, unless that failed
/// too.
void Odometry::State::reset_map() {
  motion_is_known = scans >= kInitialScans && motion_prior.inputs.measure_motion();
  if (scans < kInitialScans) T_map_base = T_accepted;
  scans = 0;
  failures = 0;
  doubts = 0;
  relocalization_attempts = 0;
  mean_agreement = 0.0;
  mean_known_share = 0.0;
  coarse_scans_left = kMinScansWithNdt;
  prediction_error_m = 0.0;
  stationary_detector.end();
  registration = {};
}

void Odometry::State::start(const Scan& scan, OdometryResult& result) {
  motion_prior = motion_prior_for(scan);
  const Time middle = motion_prior.span.middle();
  if (first_sweep.empty()) align_with_gravity(scan);
  if (!motion_is_known) {
    motion_filter.reset(T_map_base, middle);
    gravity_known = false;
  } else {
    motion_filter.propagate(motion_prior.inputs, middle);
    motion_filter.begin_map();
    follow(motion_filter.state());
    T_map_base = motion_filter.state().T_map_base * motion.T_middle_end();
  }
  first_sweep = sweep;
  first_span = motion_prior.span;
  sigma_m = kMaxSigmaMetres;
  plane_voxel_m = plane_voxel_for(config, scan.beam_spacing_rad);
  T_predicted = T_map_base;
  T_accepted = T_map_base;
  rebuild_first_map();
  result.stop_reason = StopReason::kConverged;
  for (const auto stage : {OdometryStage::kFiltered, OdometryStage::kCoarse, OdometryStage::kFine})
    stamp(result, stage);
}

void Odometry::State::rebuild_first_map() {
  // The gyro has not been tested yet.
  MotionState state = motion_filter.state();
  state.time = first_span.middle();
  const SweepMotion first_motion(first_span, state, {});
  first_motion.deskew(first_sweep, deskewed);
  T_map_last_middle = T_map_base * first_motion.T_middle_end().inverse();
  last_middle = first_span.middle();
  motion_filter.set_pose(T_map_last_middle);
  motion = first_motion;
  planes.reset(plane_voxel_m);
  if (point_map) point_map->clear();
  ndt_map.clear();
  insert(first_sweep, deskewed, T_map_last_middle);
}

void Odometry::State::insert(const std::vector<SweepPoint>& seen, const std::vector<Eigen::Vector3f>& points,
                             const SE3& T_odom_moving) {
  const Matrix3 R = T_odom_moving.rotation.toRotationMatrix();
  world_points.clear();
  for (const Eigen::Vector3f& p : points)
    world_points.emplace_back(R * p.cast<double>() + T_odom_moving.translation);
  // The two insertions are independent. `order` is only an address for the ThreadSanitizer annotations.
  static char order;
  const auto feed_planes = [&] {
    sanitizer_acquire(&order);
    insert_planes(seen);
    sanitizer_release(&order);
  };
  const auto feed_coarse = [&] {
    sanitizer_acquire(&order);
    insert_coarse(points);
    sanitizer_release(&order);
  };
  sanitizer_release(&order);
  tbb::parallel_invoke(feed_planes, feed_coarse);
  sanitizer_acquire(&order);
}

void Odometry::State::insert_planes(const std::vector<SweepPoint>& seen) {
  beams.clear();
  for (const SweepPoint& point : seen) beams.push_back(point.beam);
  planes.insert(world_points, beams);
  if (point_map) point_map->insert(world_points);
}

void Odometry::State::insert_coarse(const std::vector<Eigen::Vector3f>& points) {
  // The NDT map needs few points per voxel: downsampled in scan order.
  filter.begin(kCoarseVoxelMetres * (is_initializing_map ? kInitialVoxelShare : 1.0F));
  coarse_world_points.clear();
  const auto position_of = [&](std::size_t i, Eigen::Vector3f& position) {
    position = points[i];
    return true;
  };
  filter.thin(points.size(), position_of,
              [&](std::size_t i) { coarse_world_points.push_back(world_points[i]); });
  ndt_map.insert(coarse_world_points);
}

void Odometry::State::apply_pending_map_update() {
  if (!std::exchange(map_update_pending, false)) return;
  tbb::task_arena& threads = sweep.size() < kMinSharedPoints ? single_thread_arena : arena;
  threads.execute([this] { update_maps(); });
}

/// The registered points and the map without them tell the errors of the beams.
void Odometry::State::calibrate_beams() {
  const PlaneMetric metric;
  const double point_variance = metric.point_deviation_m * metric.point_deviation_m;
  const SE3 T_map_lidar = motion_filter.state().T_map_base * config.T_base_lidar;
  const Matrix3 R_map_lidar = T_map_lidar.rotation.toRotationMatrix();
  const SE3 T_lidar_base = config.T_base_lidar.inverse();
  motion.deskew(selected_sweep, selected);
  for (std::size_t i = 0; i < selected.size(); ++i) {
    const Vector3 p = T_lidar_base * selected[i].cast<double>();
    const Vector3 q = T_map_lidar * p;
    const VoxelIndex index = planes.index_of(q);
    const GaussianVoxel* surface = planes.find(index);
    if (surface == nullptr || static_cast<double>(surface->planarity) > metric.max_planarity) continue;
    const Vector3 normal = surface->normal.cast<double>();
    const double distance_m = normal.dot(q - planes.corner_of(index) - surface->mean.cast<double>());
    const double square = distance_m * distance_m;
    if (square > kGateSigmas * kGateSigmas * point_variance) continue;
    const double root = point_variance / (point_variance + square);
    const double certainty = point_variance / (point_variance + static_cast<double>(surface->thickness));
    beam_calibration.add(
        {selected_sweep[i].beam, p, R_map_lidar.transpose() * normal, distance_m, root * root * certainty});
  }
  beam_calibration.update(measurement_variance(registration.equations));
}

void Odometry::State::update_maps() {
  motion.deskew(sweep, deskewed);
  const Vector6 twist = motion_filter.state().twist();
  const bool is_stationary =
      twist.head<3>().norm() < kStationarySpeed && twist.tail<3>().norm() < kStationaryTurnRate;
  const SE3 T_map_middle = motion_filter.state().T_map_base;
  const SE3 since_fed = T_last_keyframe.inverse() * T_map_middle;
  const bool got_somewhere = since_fed.translation.norm() > kStationaryMetres ||
                             so3_log(since_fed.rotation).norm() > kStationaryRadians;
  const bool moved_as_known = failures == 0 && !doubtful;
  const bool is_observed = registration.degenerate_axes == 0 && !motion_prior.is_stationary;
  if (config.calibrate_beams && moved_as_known && is_observed && scans > kInitialScans) calibrate_beams();
  if (moved_as_known && (is_initializing_map || (!is_stationary && got_somewhere))) {
    insert(sweep, deskewed, T_map_middle);
    T_last_keyframe = T_map_middle;
  }
  // Readers of the points want them at the end of the scan.
  const SE3 T_end_middle = motion.T_middle_end().inverse();
  const Eigen::Matrix3f R = T_end_middle.rotation.toRotationMatrix().cast<float>();
  const Eigen::Vector3f t = T_end_middle.translation.cast<float>();
  for (Eigen::Vector3f& point : deskewed) point = R * point + t;
  planes.evict_far_from(T_map_base.translation);
  if (point_map) point_map->evict_far_from(T_map_base.translation);
  ndt_map.evict_far_from(T_map_base.translation);
}

}  // namespace nilio::core
