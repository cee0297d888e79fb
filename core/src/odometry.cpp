#include "nilio/core/odometry.hpp"

#include "nilio/core/imu_buffer.hpp"
#include "nilio/core/point_selection.hpp"
#include "nilio/core/pose_covariance.hpp"
#include "nilio/core/sweep.hpp"
#include "nilio/core/sweep_motion.hpp"
#include "nilio/core/voxel_map.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include <tbb/task_arena.h>

namespace nilio::core {

namespace {

// Scans until map and velocity are established. The map is fed more densely meanwhile: one thinned scan
// leaves its voxels short of the points that a plane needs.
constexpr std::uint64_t kInitialScans = 5;
constexpr float kInitialVoxelShare = 0.5F;
// Two neighbouring beams meet a wall this far away in one voxel: what a plane voxel needs at 16 beams.
constexpr double kPlaneReachMetres = 45.0;
constexpr double kMinPlaneVoxelMetres = 1.0;
constexpr double kMaxPlaneVoxelMetres = 2.0;
// The gate follows the prediction error: forgetting factor, limits, and the lever that turns rotation into
// distance.
constexpr double kErrorMemory = 0.9;
constexpr double kMinSigmaMetres = 0.1;
constexpr double kMaxSigmaMetres = 2.0;
constexpr double kErrorLeverMetres = 30.0;
constexpr double kGateSigmas = 3.0;
constexpr double kKernelSigmas = 0.5;
// Wide first, then exact: with this schedule NDT's basin reaches as far as its voxels see (3 m at 2 m
// voxels).
constexpr std::array<double, 2> kKernelSchedule = {5.0, 2.0};
constexpr std::size_t kCoarsePoints = 800;
constexpr float kCoarseVoxelMetres = 1.0F;
// Start and recovery: speeds to try along the vehicle's axis, as displacements a scan.
constexpr std::array<double, 5> kStartDisplacementsMetres = {0.0, 1.5, 3.0, 4.5, -1.5};
// Share of a scan's measured motion that deskewing and the next prediction believe at once.
constexpr double kVelocityGain = 0.8;
constexpr double kRotationGain = 0.8;
// Deskewing again pays only when the motion changed by more than registration resolves.
constexpr double kMotionEpsilonMetres = 5e-3;
constexpr double kMotionEpsilonRadians = 5e-4;
constexpr double kCoarseTriggerErrorMetres = 0.5;
constexpr double kCoarseTriggerGap = 1.5;
constexpr double kPeriodMemory = 0.9;
// An inlier share below this part of its running mean is not tracking.
constexpr double kInlierCollapse = 0.6;
constexpr double kInlierMemory = 0.95;
constexpr int kLostAfterFailures = 5;
// No road vehicle is faster, or turns faster.
constexpr double kMaxSpeed = 90.0;
constexpr double kMaxTurnRate = 6.0;
constexpr double kGyroBiasGain = 0.02;
constexpr double kMaxGyroBias = 0.1;
// Below both, the vehicle stands and the map is not fed: noise would thicken its planes for ever.
constexpr double kStandingSpeed = 0.05;
constexpr double kStandingTurnRate = 0.01;
constexpr double kStillForceDeviation = 0.5;
constexpr double kGravity = 9.81;

double plane_voxel_for(const OdometryConfig& config, float beam_spacing_rad) {
  if (config.plane_voxel_m > 0.0) return config.plane_voxel_m;
  return std::clamp(kPlaneReachMetres * static_cast<double>(beam_spacing_rad), kMinPlaneVoxelMetres,
                    kMaxPlaneVoxelMetres);
}

/// Every k-th element, at most `target` of them.
void thin_evenly(const std::vector<Eigen::Vector3f>& points, std::size_t target,
                 std::vector<Eigen::Vector3f>& output) {
  output.clear();
  const std::size_t count = std::min(target, points.size());
  for (std::size_t i = 0; i < count; ++i) output.push_back(points[i * points.size() / count]);
}

}  // namespace

struct Odometry::State {
  explicit State(const OdometryConfig& configuration, ClockFunction clock_function)
      : config(configuration),
        clock(clock_function),
        arena(configuration.threads),
        imu(configuration.imu_capacity),
        coarse_map({config.coarse_voxel_m, config.map_radius_m, config.coarse_map_capacity}),
        filter(config.max_filtered_points),
        coarse_filter(config.max_filtered_points),
        selector(config.max_filtered_points) {}

  void stamp(OdometryResult& result, OdometryStage stage) const {
    if (clock != nullptr) result.stage_ns[static_cast<std::size_t>(stage)] = clock();
  }

  // The steps of the algorithm, in the order of use.
  void filter_points(const Scan& scan, OdometryResult& result);
  void start(const Scan& scan, OdometryResult& result);
  void predict(const Scan& scan, OdometryResult& result);
  void select_points();
  [[nodiscard]] bool coarse_is_due(const Scan& scan) const;
  void register_coarse(OdometryResult& result);
  void register_from_standstill(OdometryResult& result);
  void register_points(bool coarse, OdometryResult& result);
  void rebuild_first_map();
  [[nodiscard]] bool is_plausible(const OdometryResult& result) const;
  void accept(OdometryResult& result);
  void fall_back(OdometryResult& result);
  void update_map(OdometryResult& result);

  // Parts of the steps.
  void prepare_maps(const Scan& scan);
  void align_with_gravity(const Scan& scan);
  void set_rotation(const SweepMotion::Span& span, bool with_imu, SweepMotion& target) const;
  void insert(const std::vector<Eigen::Vector3f>& points, const SE3& T_odom_moving);
  [[nodiscard]] PlaneMetric plane_metric() const;
  [[nodiscard]] MotionGain motion_gain() const;
  RegistrationResult register_fine(const std::vector<Eigen::Vector3f>& points, const SE3& T_guess,
                                   OdometryResult& result);
  void learn_gyro_bias(const OdometryResult& result);
  void learn_prediction_error();

  OdometryConfig config;
  ClockFunction clock;
  tbb::task_arena arena;
  ImuBuffer imu;
  std::optional<VoxelMap> planes;
  VoxelMap coarse_map;
  VoxelFilter filter;
  VoxelFilter coarse_filter;
  PointSelector selector;
  SweepMotion motion;

  std::uint64_t scans = 0;
  SE3 T_odom_base;
  Time time;
  SE3 T_predicted;
  bool imu_used = false;
  bool motion_compensated = false;
  SweepMotion::Span span;
  Vector3 body_velocity = Vector3::Zero();
  Vector3 angular_velocity = Vector3::Zero();
  Vector3 gyro_bias = Vector3::Zero();
  std::uint64_t bias_updates = 0;
  double sigma_m = kMaxSigmaMetres;
  double prediction_error_m = 0.0;
  double period_s = 0.1;  ///< between poses, slowly averaged
  double mean_inlier_ratio = 0.0;
  int failures = 0;
  RegistrationResult registration;

  // The first scan is kept until the second has told how fast the vehicle was.
  std::vector<SweepPoint> first_sweep;
  SweepMotion::Span first_span;

  std::vector<SweepPoint> sweep;
  std::vector<SweepPoint> selected_sweep;
  std::vector<std::uint32_t> selection;
  std::vector<Eigen::Vector3f> deskewed;
  std::vector<Eigen::Vector3f> selected;
  std::vector<Eigen::Vector3f> coarse_points;
  std::vector<Vector3> world_points;
};

void Odometry::State::prepare_maps(const Scan& scan) {
  if (planes) return;
  planes.emplace(VoxelMapConfig{plane_voxel_for(config, scan.beam_spacing_rad), config.map_radius_m,
                                config.map_capacity});
}

void Odometry::State::filter_points(const Scan& scan, OdometryResult& result) {
  const float share = scans < kInitialScans ? kInitialVoxelShare : 1.0F;
  const ScanFilterConfig filter_config{config.min_range_m, config.max_range_m, config.filter_voxel_m * share,
                                       config.elevation_correction_rad};
  filter_scan(scan, filter_config, config.T_base_lidar, filter, sweep);
  motion_compensated = scan.motion_compensated;
  if (motion_compensated) {
    for (SweepPoint& point : sweep) point.time_s = 0.0F;
  }
  result.points = static_cast<std::uint32_t>(scan.points.size());
  result.points_filtered = static_cast<std::uint32_t>(sweep.size());
}

void Odometry::State::set_rotation(const SweepMotion::Span& target_span, bool with_imu,
                                   SweepMotion& target) const {
  if (with_imu) {
    target.set_rotation_from_imu(target_span, imu, gyro_bias);
  } else {
    target.set_constant_rotation(target_span, angular_velocity);
  }
}

void Odometry::State::align_with_gravity(const Scan& scan) {
  const ImuStatistics statistics = imu_statistics(imu, scan.start, scan.end);
  const double force = statistics.mean_acceleration.norm();
  if (statistics.count < 2 || statistics.acceleration_deviation > kStillForceDeviation) return;
  if (std::abs(force - kGravity) > kStillForceDeviation) return;
  T_odom_base.rotation = Eigen::Quaterniond::FromTwoVectors(statistics.mean_acceleration, Vector3::UnitZ());
}

void Odometry::State::start(const Scan& scan, OdometryResult& result) {
  align_with_gravity(scan);
  first_sweep = sweep;
  first_span = {scan.start, scan.start, scan.end};
  span = first_span;
  imu_used = imu.covers(scan.start, scan.end, config.max_imu_gap);
  T_predicted = T_odom_base;
  rebuild_first_map();
  deskewed.resize(sweep.size());
  result.stop_reason = StopReason::kConverged;
}

void Odometry::State::rebuild_first_map() {
  SweepMotion first_motion;
  set_rotation(first_span, imu.covers(first_span.start, first_span.end, config.max_imu_gap), first_motion);
  first_motion.predict(body_velocity);
  first_motion.deskew(first_sweep, deskewed);
  planes->clear();
  coarse_map.clear();
  insert(deskewed, T_odom_base);
}

void Odometry::State::predict(const Scan& scan, OdometryResult& result) {
  span = {time, scan.start, scan.end};
  imu_used = imu.covers(time, scan.end, config.max_imu_gap);
  set_rotation(span, imu_used, motion);
  T_predicted = T_odom_base * motion.predict(body_velocity);
  result.imu_used = imu_used;
}

void Odometry::State::select_points() {
  motion.deskew(sweep, deskewed);
  const SelectionConfig selection_config{config.registration_points, kCoarseVoxelMetres,
                                         plane_metric().max_planarity};
  selector.select(*planes, deskewed, T_predicted, selection_config, selection);
  selected_sweep.clear();
  for (const std::uint32_t index : selection) selected_sweep.push_back(sweep[index]);
  thin_evenly(deskewed, kCoarsePoints, coarse_points);
}

bool Odometry::State::coarse_is_due(const Scan& scan) const {
  if (config.coarse == CoarsePolicy::kAlways || scans < kInitialScans || failures > 0) return true;
  return prediction_error_m > kCoarseTriggerErrorMetres ||
         (scan.end - time).seconds() > kCoarseTriggerGap * period_s;
}

PlaneMetric Odometry::State::plane_metric() const {
  PlaneMetric metric;
  metric.gate_m = kGateSigmas * sigma_m;
  metric.kernel_scale_m = kKernelSigmas * sigma_m;
  return metric;
}

MotionGain Odometry::State::motion_gain() const {
  // Nothing is predicted yet that could be worth keeping, except a gyro's rotation.
  const bool initial = scans < kInitialScans;
  return {imu_used ? 0.0 : initial ? 1.0 : kRotationGain, initial ? 1.0 : kVelocityGain};
}

RegistrationResult Odometry::State::register_fine(const std::vector<Eigen::Vector3f>& points,
                                                  const SE3& T_guess, OdometryResult& result) {
  SolverOptions options;
  options.max_iterations = config.max_fine_iterations;
  const RegistrationResult fine = register_planes(*planes, points, T_guess, plane_metric(), {}, options);
  result.fine_iterations += fine.iterations;
  return fine;
}

void Odometry::State::register_coarse(OdometryResult& result) {
  SolverOptions options;
  options.max_iterations = config.max_coarse_iterations;
  const RegistrationResult coarse =
      register_ndt(coarse_map, coarse_points, registration.T_map_moving, kKernelSchedule, options);
  result.coarse_iterations += coarse.iterations;
  if (coarse.stop_reason == StopReason::kConverged || coarse.stop_reason == StopReason::kMaxIterations) {
    registration.T_map_moving = coarse.T_map_moving;
  }
}

void Odometry::State::register_from_standstill(OdometryResult& result) {
  // Nothing is known of the speed: try several along the vehicle's axis and keep the one most points agree
  // with.
  SolverOptions options;
  options.max_iterations = config.max_coarse_iterations;
  std::uint32_t best_inliers = 0;
  SE3 T_best = T_predicted;
  for (const double displacement : kStartDisplacementsMetres) {
    const SE3 T_guess = T_predicted * SE3{Eigen::Quaterniond::Identity(), Vector3(displacement, 0.0, 0.0)};
    const RegistrationResult coarse =
        register_ndt(coarse_map, coarse_points, T_guess, kKernelSchedule, options);
    const RegistrationResult fine = register_fine(coarse_points, coarse.T_map_moving, result);
    result.coarse_iterations += coarse.iterations;
    if (fine.T_map_moving.is_finite() && fine.equations.inliers > best_inliers) {
      best_inliers = fine.equations.inliers;
      T_best = fine.T_map_moving;
    }
  }
  registration.T_map_moving = T_best;
  motion.refine(T_odom_base.inverse() * T_best, motion_gain());
}

void Odometry::State::register_points(bool coarse, OdometryResult& result) {
  for (int pass = 0; pass < config.max_passes; ++pass) {
    motion.deskew(selected_sweep, selected);
    const SE3 T_assumed = registration.T_map_moving;
    if (coarse && pass == 0) register_coarse(result);
    if (pass == 0) stamp(result, OdometryStage::kCoarse);
    registration = register_fine(selected, registration.T_map_moving, result);
    ++result.passes;
    if (!registration.T_map_moving.is_finite()) return;
    motion.refine(T_odom_base.inverse() * registration.T_map_moving, motion_gain());
    const SE3 change = T_assumed.inverse() * registration.T_map_moving;
    const bool settled = change.translation.norm() < kMotionEpsilonMetres &&
                         so3_log(change.rotation).norm() < kMotionEpsilonRadians;
    if (settled || motion_compensated) return;
  }
}

bool Odometry::State::is_plausible(const OdometryResult& result) const {
  const RegistrationResult& r = registration;
  if (!r.T_map_moving.is_finite() || r.stop_reason == StopReason::kTooFewPoints ||
      r.stop_reason == StopReason::kNonFinite) {
    return false;
  }
  if (motion.body_velocity().norm() > kMaxSpeed || motion.mean_angular_velocity().norm() > kMaxTurnRate)
    return false;
  return scans < kInitialScans || result.inlier_ratio > kInlierCollapse * mean_inlier_ratio;
}

void Odometry::State::learn_gyro_bias(const OdometryResult& result) {
  const double span_s = (span.end - span.previous).seconds();
  if (!result.imu_used || span_s <= 0.0) return;
  const Vector3 error =
      so3_log(registration.T_map_moving.rotation.conjugate() * T_predicted.rotation) / span_s;
  const double gain = std::max(kGyroBiasGain, 1.0 / static_cast<double>(bias_updates + 2));
  ++bias_updates;
  gyro_bias = (gyro_bias + gain * error).cwiseMax(-kMaxGyroBias).cwiseMin(kMaxGyroBias);
}

void Odometry::State::learn_prediction_error() {
  const SE3 error = T_predicted.inverse() * registration.T_map_moving;
  const double angle = so3_log(error.rotation).norm();
  prediction_error_m = error.translation.norm() + 2.0 * kErrorLeverMetres * std::sin(0.5 * angle);
  const double square =
      kErrorMemory * sigma_m * sigma_m + (1.0 - kErrorMemory) * prediction_error_m * prediction_error_m;
  sigma_m = std::clamp(std::sqrt(square), kMinSigmaMetres, kMaxSigmaMetres);
}

void Odometry::State::accept(OdometryResult& result) {
  learn_gyro_bias(result);
  learn_prediction_error();
  body_velocity = motion.body_velocity();
  angular_velocity = motion.mean_angular_velocity();
  mean_inlier_ratio = mean_inlier_ratio == 0.0
                          ? result.inlier_ratio
                          : kInlierMemory * mean_inlier_ratio + (1.0 - kInlierMemory) * result.inlier_ratio;
  failures = 0;
  const double span_s = (span.end - span.previous).seconds();
  period_s = scans == 1 ? span_s : kPeriodMemory * period_s + (1.0 - kPeriodMemory) * span_s;
  T_odom_base = registration.T_map_moving;
  result.stop_reason = registration.stop_reason;
  result.degenerate_axes = registration.degenerate_axes;
  result.state = scans < kInitialScans               ? TrackingState::kInitialising
                 : registration.degenerate_axes != 0 ? TrackingState::kDegraded
                                                     : TrackingState::kTracking;
}

void Odometry::State::fall_back(OdometryResult& result) {
  ++failures;
  motion.predict(body_velocity);
  T_odom_base = T_predicted;
  sigma_m = std::min(kMaxSigmaMetres, 2.0 * sigma_m);
  result.predicted = true;
  result.stop_reason =
      registration.stop_reason == StopReason::kConverged ? StopReason::kDegenerate : registration.stop_reason;
  result.state = failures >= kLostAfterFailures ? TrackingState::kLost : TrackingState::kDegraded;
}

void Odometry::State::insert(const std::vector<Eigen::Vector3f>& points, const SE3& T_odom_moving) {
  const Matrix3 R = T_odom_moving.rotation.toRotationMatrix();
  world_points.clear();
  for (const Eigen::Vector3f& p : points)
    world_points.emplace_back(R * p.cast<double>() + T_odom_moving.translation);
  planes->insert(world_points);
  // The coarse level needs few points a voxel: feed it thinned, in the order of the scan.
  coarse_filter.begin(kCoarseVoxelMetres * (scans < kInitialScans ? kInitialVoxelShare : 1.0F));
  std::size_t kept = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (coarse_filter.insert(points[i])) world_points[kept++] = world_points[i];
  }
  coarse_map.insert(std::span(world_points).first(kept));
}

void Odometry::State::update_map(OdometryResult& result) {
  motion.deskew(sweep, deskewed);
  const bool stands = body_velocity.norm() < kStandingSpeed && angular_velocity.norm() < kStandingTurnRate;
  if (!result.predicted && (scans < kInitialScans || !stands)) insert(deskewed, T_odom_base);
  planes->evict_far_from(T_odom_base.translation);
  coarse_map.evict_far_from(T_odom_base.translation);
}

Odometry::Odometry(const OdometryConfig& config, ClockFunction clock)
    : state_(std::make_unique<State>(config, clock)) {}
Odometry::Odometry(Odometry&&) noexcept = default;
Odometry& Odometry::operator=(Odometry&&) noexcept = default;
Odometry::~Odometry() = default;

bool Odometry::add_imu(const ImuSample& sample) {
  return state_->imu.add(sample, state_->config.T_base_imu.rotation);
}

std::optional<Time> Odometry::latest_imu() const { return state_->imu.latest(); }

const std::vector<Eigen::Vector3f>& Odometry::deskewed_points() const { return state_->deskewed; }

OdometryResult Odometry::register_scan(const Scan& scan) {
  State& s = *state_;
  OdometryResult result;
  result.sequence = scan.sequence;
  result.scan_start = scan.start;
  result.scan_end = scan.end;
  s.stamp(result, OdometryStage::kStarted);
  s.prepare_maps(scan);
  s.filter_points(scan, result);
  if (s.scans == 0) {
    s.start(scan, result);
    for (const auto stage : {OdometryStage::kFiltered, OdometryStage::kCoarse, OdometryStage::kFine})
      s.stamp(result, stage);
  } else {
    s.predict(scan, result);
    s.select_points();
    s.stamp(result, OdometryStage::kFiltered);
    s.arena.execute([&] {
      s.registration = {};
      s.registration.T_map_moving = s.T_predicted;
      if (s.scans == 1) {
        s.register_from_standstill(result);
        s.body_velocity = s.motion.body_velocity();
        s.angular_velocity = s.motion.mean_angular_velocity();
        s.rebuild_first_map();
        s.T_predicted = s.registration.T_map_moving;
        s.select_points();
      }
      s.register_points(s.scans > 1 && s.coarse_is_due(scan), result);
    });
    s.stamp(result, OdometryStage::kFine);
    result.points_used = static_cast<std::uint32_t>(s.selected.size());
    result.correspondences = s.registration.equations.correspondences;
    result.inlier_ratio = s.selected.empty() ? 0.0
                                             : static_cast<double>(s.registration.equations.inliers) /
                                                   static_cast<double>(s.selected.size());
    if (s.is_plausible(result)) {
      s.accept(result);
    } else {
      s.fall_back(result);
    }
    s.update_map(result);
  }
  s.time = scan.end;
  ++s.scans;
  result.T_odom_base = s.T_odom_base;
  result.map_voxels = static_cast<std::uint32_t>(s.planes->size());
  result.map_refused = s.planes->refused() + s.coarse_map.refused();
  fill_covariance(s.registration, (s.span.end - s.span.previous).seconds(), result);
  result.twist.head<3>() = s.motion.body_velocity();
  result.twist.tail<3>() = s.motion.mean_angular_velocity();
  s.stamp(result, OdometryStage::kMapped);
  return result;
}

}  // namespace nilio::core
