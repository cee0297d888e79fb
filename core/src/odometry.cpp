#include "nilio/core/odometry.hpp"

#include "nilio/core/pose_covariance.hpp"

#include "odometry_state.hpp"

namespace nilio::core {

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

std::optional<Time> Odometry::latest_imu() const { return state_->imu.latest(); }

const ImuHealth& Odometry::imu_health() const { return state_->monitor.health(); }

const std::vector<Eigen::Vector3f>& Odometry::deskewed_points() const { return state_->deskewed; }

OdometryResult Odometry::State::result_for(const Scan& scan) {
  OdometryResult result;
  result.sequence = scan.sequence;
  result.scan_start = scan.start;
  result.scan_end = scan.end;
  return result;
}

Odometry::State::Outlook Odometry::State::outlook(const Scan& scan) const {
  Outlook result;
  result.span = {time, scan.motion_compensated ? scan.end : scan.start, scan.end};
  result.imu_covers = imu.covers(time, scan.end - kMaxImuLag, config.max_imu_gap);
  result.imu_used = result.imu_covers && monitor.usable(time, scan.end);
  if (result.imu_covers) result.acceleration = felt_acceleration(result);
  return result;
}

/// The motion `moved`, and what the samples of the IMU are corrected by.
void Odometry::State::fill_motion(const SweepMotion& moved, OdometryResult& result) const {
  result.twist.head<3>() = moved.body_velocity();
  result.twist.tail<3>() = moved.mean_angular_velocity();
  result.gyro_bias = gyro_bias;
  result.imu_time_shift = monitor.time_shift();
}

void Odometry::State::finish(const Scan& scan, OdometryResult& result) {
  if (scans > 0) {
    last_half_sweep = motion.half_sweep();
    last_sweep_s = motion.sweep_s();
  }
  time = scan.end;
  ++scans;
  last_fine_iterations = static_cast<std::size_t>(result.fine_iterations);
  result.T_odom_base = T_odom_map * T_map_base;
  count_map(result);
  drift.advance(result.predicted ? 0 : registration.degenerate_axes, prediction_square);
  if (!result.predicted) registered_time = time;
  fill_covariance({registration, prediction_square, drift.variance(), ahead.span_s(),
                   (time - registered_time).seconds()},
                  result);
  fill_motion(motion, result);
  result.rung = rung_of(result);
  if (result.state != TrackingState::kInitialising && !is_drivable_step(T_map_base, ahead.span_s()))
    result.state = TrackingState::kLost;
  T_published = T_map_base;
  published_speed = result.twist.head<3>().norm();
}

void Odometry::State::count_map(OdometryResult& result) const {
  result.map_voxels = static_cast<std::uint32_t>(planes.size());
  result.map_refused = planes.refused() + coarse_map.refused();
}

/// NI-LIO section 3: preprocess, predict with the IMU, NDT coarse and ICP fine until convergence. The map is
/// updated by update_map().
OdometryResult Odometry::register_within_budget(const Scan& scan) {
  State& s = *state_;
  OdometryResult result = State::result_for(scan);
  s.stamp(result, OdometryStage::kStarted);
  s.filter_points(scan, result);
  if (s.restart_is_due()) s.forget_map();
  if (s.scans == 0) {
    s.arena.execute([&] { s.start(scan, result); });
  } else {
    s.predict(scan, result);
    // The second scan tells first how fast the vehicle is, then what to select.
    if (s.scans > 1) s.select_points(s.T_predicted);
    s.budget.done(Work::kPrepare, s.scan_points);
    s.stamp(result, OdometryStage::kFiltered);
    s.registration_arena().execute([&] {
      s.register_sweep(result);
      s.reconsider_imu(result);
    });
    s.stamp(result, OdometryStage::kFine);
    s.judge(result);
    s.map_is_behind = true;
  }
  s.finish(scan, result);
  return result;
}

OdometryResult Odometry::register_scan(const Scan& scan) {
  State& s = *state_;
  s.catch_up_with_map();
  s.budget.begin_scan(scan.received_ns, s.scans < kInitialScans);
  return register_within_budget(scan);
}

OdometryResult Odometry::register_scan(const Scan& scan, const BudgetDecisions& decisions) {
  State& s = *state_;
  s.catch_up_with_map();
  s.budget.begin_scan(decisions, s.scans < kInitialScans);
  return register_within_budget(scan);
}

void Odometry::update_map(OdometryResult& result) {
  State& s = *state_;
  s.catch_up_with_map();
  s.count_map(result);
  s.stamp(result, OdometryStage::kMapped);
}

const WorkBudget& Odometry::budget() const { return state_->budget; }

void Odometry::note_handed_over(const OdometryResult& result) {
  state_->budget.finish_scan(result.fine_iterations);
}

OdometryResult Odometry::predict_pose(const Scan& scan) const {
  const State& s = *state_;
  OdometryResult result = State::result_for(scan);
  SweepMotion motion;
  const State::Outlook outlook = s.outlook(scan);
  result.imu_used = outlook.imu_used;
  const SE3 T_map_base = s.scans == 0 ? s.T_map_base : s.expected_pose(outlook, motion);
  result.T_odom_base = s.T_odom_map * T_map_base;
  result.predicted = true;
  s.fill_motion(motion, result);
  result.rung = BudgetRung::kPredictionOnly;
  result.stop_reason = StopReason::kBudget;
  result.state = s.state_without_registration(1);
  if (result.state != TrackingState::kInitialising &&
      !s.is_drivable_step(T_map_base, (scan.end - s.time).seconds()))
    result.state = TrackingState::kLost;
  fill_covariance(
      {{}, s.prediction_square, s.drift.variance(), (scan.end - s.time).seconds(),
       (scan.end - s.registered_time).seconds()},
      result);
  return result;
}

}  // namespace nilio::core
