#include "odometry_state.hpp"
#include "thread_sanitizer.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include <tbb/parallel_invoke.h>

namespace nilio::core {

namespace {

// Two neighbouring beams meet a wall this far away in one voxel: what a plane voxel needs at 16 beams.
constexpr double kPlaneReachMetres = 45.0;
constexpr double kMinPlaneVoxelMetres = 1.0;
constexpr double kMaxPlaneVoxelMetres = 2.0;
// Fewer points are fed to both maps before a second thread has woken up.
constexpr std::size_t kLeastSharedPoints = 8000;
// Below both, the vehicle stands and the map is not fed: noise would thicken its planes for ever.
constexpr double kStandingSpeed = 0.05;
constexpr double kStandingTurnRate = 0.01;
// One scan's noise alone can look like a speed above these; a vehicle that moves also gets somewhere.
constexpr double kStandingMetres = 0.02;
constexpr double kStandingRadians = 0.002;
// Fewer points make no map to register against.
constexpr std::size_t kMinStartPoints = 50;
constexpr double kStillForceDeviation = 0.5;

}  // namespace

double plane_voxel_for(const OdometryConfig& config, float beam_spacing_rad) {
  if (config.plane_voxel_m > 0.0) return config.plane_voxel_m;
  return std::clamp(kPlaneReachMetres * static_cast<double>(beam_spacing_rad), kMinPlaneVoxelMetres,
                    kMaxPlaneVoxelMetres);
}

void Odometry::State::filter_points(const Scan& scan, OdometryResult& result) {
  feeds_densely = scans < kInitialScans;
  // Where points stand for the surface between them, all are needed.
  const std::size_t most_points = method.needs_points ? scan.points.size() : config.scan_points;
  scan_points = budget.choose_scan_points(std::min(most_points, scan.points.size()));
  const float share = scans == 0 ? kFirstVoxelShare : feeds_densely ? kInitialVoxelShare : 1.0F;
  const ScanFilterConfig filter_config{config.min_range_m, config.max_range_m, config.filter_voxel_m * share,
                                       config.elevation_correction_rad, scan_points};
  filter_scan(scan, filter_config, config.T_base_lidar, filter, sweep);
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
  if (!shows_gravity(statistics.mean_acceleration)) return;
  T_odom_map.rotation = Eigen::Quaterniond::FromTwoVectors(statistics.mean_acceleration, Vector3::UnitZ());
}

bool Odometry::State::restart_is_due() const {
  const bool has_not_begun = failures > 0 && scans < kInitialScans;
  const bool is_elsewhere = failures >= kRestartAfterFailures || searches >= kRestartAfterSearches;
  return (has_not_begun || is_elsewhere) && sweep.size() >= kMinStartPoints;
}

/// To begin again from the predicted pose. What the vehicle did meanwhile is not known: its speed least of
/// all, and nothing could be predicted yet where it had not begun.
void Odometry::State::forget_map() {
  if (scans < kInitialScans) T_map_base = T_accepted;
  scans = 0;
  failures = 0;
  doubts = 0;
  searches = 0;
  twist.reset(Vector6::Zero());
  mean_agreement = 0.0;
  forget_prediction_error();
  scans_with_ndt = kLeastScansWithNdt;
  prediction_error_m = 0.0;
  prediction_square.setZero();
  standing_start.end();
  forget_felt_motion();
  registration = {};
}

void Odometry::State::start(const Scan& scan, OdometryResult& result) {
  // A restart knows its attitude better than the accelerometer of a moving vehicle does.
  if (first_sweep.empty()) align_with_gravity(scan);
  first_sweep = sweep;
  const Time start = motion_compensated ? scan.end : scan.start;
  first_span = {start, start, scan.end};
  ahead.span = first_span;
  plane_voxel_m = plane_voxel_for(config, scan.beam_spacing_rad);
  T_predicted = T_map_base;
  T_accepted = T_map_base;
  rebuild_first_map();
  result.stop_reason = StopReason::kConverged;
  for (const auto stage : {OdometryStage::kFiltered, OdometryStage::kCoarse, OdometryStage::kFine})
    stamp(result, stage);
}

void Odometry::State::rebuild_first_map() {
  SweepMotion first_motion;
  // The gyro has not shown yet what it is worth.
  set_rotation(first_span, false, twist.twist(), first_motion);
  first_motion.predict(twist.twist().head<3>());
  first_motion.deskew(first_sweep, deskewed);
  last_half_sweep = first_motion.half_sweep();
  last_sweep_s = first_motion.sweep_s();
  planes.reset(plane_voxel_m);
  if (point_map) point_map->clear();
  coarse_map.clear();
  insert(first_sweep, deskewed, T_map_base);
}

void Odometry::State::insert(const std::vector<SweepPoint>& seen, const std::vector<Eigen::Vector3f>& points,
                             const SE3& T_odom_moving) {
  const Matrix3 R = T_odom_moving.rotation.toRotationMatrix();
  world_points.clear();
  for (const Eigen::Vector3f& p : points)
    world_points.emplace_back(R * p.cast<double>() + T_odom_moving.translation);
  // Neither map knows of the other: the order does not matter. Only the address of this counts, which a
  // worker knows without reading what another thread has written.
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
  // The coarse level needs few points a voxel: feed it thinned, in the order of the scan.
  filter.begin(kCoarseVoxelMetres * (feeds_densely ? kInitialVoxelShare : 1.0F));
  coarse_world_points.clear();
  const auto position_of = [&](std::size_t i, Eigen::Vector3f& position) {
    position = points[i];
    return true;
  };
  filter.thin(points.size(), position_of,
              [&](std::size_t i) { coarse_world_points.push_back(world_points[i]); });
  coarse_map.insert(coarse_world_points);
}

void Odometry::State::catch_up_with_map() {
  if (!std::exchange(map_is_behind, false)) return;
  tbb::task_arena& threads = sweep.size() < kLeastSharedPoints ? lone_arena : arena;
  threads.execute([this] { update_maps(); });
}

void Odometry::State::update_maps() {
  motion.deskew(sweep, deskewed);
  const bool stands =
      twist.twist().head<3>().norm() < kStandingSpeed && twist.twist().tail<3>().norm() < kStandingTurnRate;
  // The middle of the sweep is known better than its end.
  const SE3 T_map_middle = T_map_base * motion.half_sweep().inverse();
  const SE3 since_fed = T_fed.inverse() * T_map_middle;
  const bool got_somewhere =
      since_fed.translation.norm() > kStandingMetres || so3_log(since_fed.rotation).norm() > kStandingRadians;
  const bool moved_as_known = failures == 0 && !doubtful;
  if (moved_as_known && (feeds_densely || (!stands && got_somewhere))) {
    insert(sweep, deskewed, T_map_base);
    T_fed = T_map_middle;
  }
  planes.evict_far_from(T_map_base.translation);
  if (point_map) point_map->evict_far_from(T_map_base.translation);
  coarse_map.evict_far_from(T_map_base.translation);
}

}  // namespace nilio::core
