#include "nilio/core/odometry.hpp"

#include "core/src/odometry_impl.hpp"

namespace nilio::core {

namespace {

// Share of the time between scans.
constexpr double kRecoveryShare = 0.5;
// Time after a jump in which poses are lost.
constexpr Duration kJumpMemory = Duration::from_seconds(1.0);

}  // namespace

Odometry::Odometry(const OdometryConfig& config, ClockFunction clock)
    : state_(std::make_unique<State>(config, clock)) {}
Odometry::Odometry(Odometry&&) noexcept = default;
Odometry& Odometry::operator=(Odometry&&) noexcept = default;
Odometry::~Odometry() = default;

bool Odometry::add_imu(const ImuSample& sample) {
  ImuSample in_lidar_time = sample;
  in_lidar_time.stamp = sample.stamp - state_->monitor.time_shift();
  if (!state_->imu.add(in_lidar_time, state_->config.T_base_imu.rotation)) return false;
  state_->monitor.add(sample);
  return true;
}

const ImuHealth& Odometry::imu_health() const { return state_->monitor.health(); }

const std::vector<Eigen::Vector3f>& Odometry::deskewed_points() const { return state_->deskewed; }

float Odometry::deskewed_intensity(std::size_t index) const { return state_->sweep[index].intensity; }

BeamCorrection Odometry::beam_correction(std::size_t ring) const {
  return state_->beam_calibration.correction_of(ring);
}

OdometryResult Odometry::State::result_for(const Scan& scan) {
  OdometryResult result;
  result.sequence = scan.sequence;
  result.scan_start = scan.start;
  result.scan_end = scan.end;
  return result;
}

/// Fills the poses of the end and the middle of a sweep.
void Odometry::State::set_poses(const SweepMotion& moved, const SE3& T_map_end,
                                OdometryResult& result) const {
  result.T_odom_base = T_odom_map * T_map_end;
  result.T_odom_base_middle = result.T_odom_base * moved.T_middle_end().inverse();
}

/// Fills twist and IMU corrections from the motion.
void Odometry::State::fill_motion(const SweepMotion& moved, const MotionState& state,
                                  OdometryResult& result) const {
  result.twist = moved.end_twist();
  result.gyro_bias = state.gyro_bias;
  result.imu_time_shift = monitor.time_shift();
}

void Odometry::State::finish(const Scan& scan, OdometryResult& result) {
  time = scan.end;
  set_poses(motion, T_map_base, result);
  ++scans;
  T_map_last_middle = motion_filter.state().T_map_base;
  last_middle = motion_filter.state().time;
  last_fine_iterations = static_cast<std::size_t>(result.fine_iterations);
  count_map(result);
  if (!result.predicted) registered_time = time;
  fill_motion(motion, motion_filter.state(), result);
  result.degradation_level = degradation_level_of(result);
  fill_confidence(motion_filter, motion, T_map_base, motion_prior.span_s(), result);
  if (result.state != TrackingState::kInitialising && !is_drivable_step(T_map_base, motion_prior.span_s()))
    jumped_at = time;
  T_published = T_map_base;
  published_speed = result.twist.head<3>().norm();
}

/// Covariance of a pose, `span_s` after the last published one; `lost` if no vehicle can have driven to it,
/// or to one of the last second: tracking vouches for the motion of a second.
void Odometry::State::fill_confidence(const MotionFilter& filter_at_middle, const SweepMotion& moved,
                                      const SE3& T_map_pose, double span_s, OdometryResult& result) const {
  MotionFilter at_end = filter_at_middle;
  at_end.propagate(motion_prior.inputs, moved.span().end);
  const Matrix6 to_odom = block_rotation(result.T_odom_base.rotation.toRotationMatrix());
  result.pose_covariance = to_odom * at_end.pose_covariance() * to_odom.transpose();
  result.twist_covariance = at_end.twist_covariance();
  const bool has_jumped = jumped_at && moved.span().end - *jumped_at < kJumpMemory;
  if (result.state != TrackingState::kInitialising && (has_jumped || !is_drivable_step(T_map_pose, span_s)))
    result.state = TrackingState::kLost;
}

/// Time for a recovery, which tries hypotheses that tracking does not need; zero while tracking. Half of the
/// time to the next scan keeps up with the scans.
Duration Odometry::State::recovery_budget(const Scan& scan) const {
  const bool is_due = scans >= kInitialScans && (recovers || is_gap((scan.end - time).seconds()));
  return is_due ? Duration::from_seconds(kRecoveryShare * period_s) : Duration{};
}

void Odometry::State::count_map(OdometryResult& result) const {
  result.map_voxels = static_cast<std::uint32_t>(planes.size());
  result.map_refused = planes.refused() + ndt_map.refused();
}

/// NI-LIO section 3: preprocess, predict with the IMU, NDT coarse and ICP fine until convergence. The map is
/// updated by update_map().
OdometryResult Odometry::register_within_budget(const Scan& scan) {
  State& s = *state_;
  OdometryResult result = State::result_for(scan);
  result.recovery_budget = s.recovery_budget(scan);
  s.stamp(result, OdometryStage::kStarted);
  s.filter_points(scan, result);
  if (s.restart_is_due()) s.reset_map();
  if (s.scans == 0) {
    s.arena.execute([&] { s.start(scan, result); });
  } else {
    s.predict(scan, result);
    // The second scan first determines the initial velocity, then selects points.
    if (s.scans > 1) s.select_points(s.T_predicted);
    s.budget.record(WorkKind::kPrepare, s.scan_points);
    s.stamp(result, OdometryStage::kFiltered);
    s.registration_arena().execute([&] { s.register_sweep(result); });
    s.stamp(result, OdometryStage::kFine);
    s.check_registration(result);
    s.map_update_pending = true;
  }
  s.finish(scan, result);
  return result;
}

OdometryResult Odometry::register_scan(const Scan& scan) {
  State& s = *state_;
  s.apply_pending_map_update();
  s.budget.begin_scan(scan.received_ns, s.scans < kInitialScans, s.recovery_budget(scan));
  return register_within_budget(scan);
}

void Odometry::update_map(OdometryResult& result) {
  State& s = *state_;
  s.apply_pending_map_update();
  s.count_map(result);
  s.stamp(result, OdometryStage::kMapped);
}

}  // namespace nilio::core
