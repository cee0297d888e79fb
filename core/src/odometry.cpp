#include "nilio/core/odometry.hpp"

#include "core/src/odometry_impl.hpp"
#include "core/src/registration/gauss_newton.hpp"

#include <algorithm>
#include <utility>

namespace nilio::core {

namespace {

// Voxels of the filter while a map begins, as shares of the configured one.
constexpr float kFirstVoxelShare = 0.5F;
constexpr float kInitialVoxelShare = 0.7F;
// Minimum number of points of a first map.
constexpr std::size_t kMinStartPoints = 50;
// Share of the time between scans.
constexpr double kRecoveryShare = 0.5;
// Times between scans in which a scan of the initialisation begins hypotheses: it delays the next ones a
// little, on a computer on which all of them take seconds.
constexpr double kInitialPeriods = 2.0;
// Points times iterations of ICP, about 0.2 ms, and points to insert, from which a second thread pays.
constexpr std::size_t kMinSharedWork = 4000;
constexpr std::size_t kMinSharedPoints = 8000;
// Below both limits the vehicle is stationary and nothing is inserted: noise would thicken planes for ever.
constexpr double kStationarySpeed = 0.05;
constexpr double kStationaryTurnRate = 0.01;

bool is_stationary(const Vector6& twist) {
  return twist.head<3>().norm() < kStationarySpeed && twist.tail<3>().norm() < kStationaryTurnRate;
}

}  // namespace

Odometry::Odometry(const OdometryConfig& config, ClockFunction clock)
    : state_(std::make_unique<State>(config, clock)) {}
Odometry::Odometry(Odometry&&) noexcept = default;
Odometry& Odometry::operator=(Odometry&&) noexcept = default;
Odometry::~Odometry() = default;

bool Odometry::add_imu(const ImuSample& sample) { return state_->motion.add_imu(sample); }

const ImuHealth& Odometry::imu_health() const { return state_->motion.monitor().health(); }

const std::vector<Eigen::Vector3f>& Odometry::deskewed_points() const {
  return state_->preprocessing.deskewed();
}

float Odometry::deskewed_intensity(std::size_t index) const {
  return state_->preprocessing.sweep()[index].intensity;
}

BeamCorrection Odometry::beam_correction(std::size_t ring) const {
  return state_->preprocessing.beam_calibration().correction_of(ring);
}

OdometryResult Odometry::register_scan(const Scan& scan) {
  State& s = *state_;
  s.update_map();
  const bool is_initialising = s.motion.is_initialising();
  const Duration time = is_initialising ? Duration::from_seconds(kInitialPeriods * s.motion.period_s())
                                        : s.recovery_budget(scan);
  s.budget.begin_scan(scan.received_ns, is_initialising, time);
  return register_within_budget(scan);
}

/// NI-LIO section 3: preprocess, predict with the IMU, NDT coarse and ICP fine until convergence. The map is
/// updated by update_map().
OdometryResult Odometry::register_within_budget(const Scan& scan) {
  State& s = *state_;
  OdometryResult result = State::result_for(scan);
  result.recovery_budget = s.recovery_budget(scan);
  s.clock.stamp(result, OdometryStage::kStarted);
  const std::size_t visited = s.filter_points(scan, result);
  if (s.restart_is_due()) s.motion.leave_map();
  if (s.motion.scans() == 0) {
    s.threads.all.execute([&] { s.start(scan, result); });
  } else {
    s.predict(scan, result);
    s.budget.record(WorkKind::kPrepare, visited);
    s.clock.stamp(result, OdometryStage::kFiltered);
    s.registration_threads().execute([&] { s.register_sweep(result); });
    s.clock.stamp(result, OdometryStage::kFine);
    s.check_alignment(result);
  }
  s.finish(result);
  return result;
}

void Odometry::update_map(OdometryResult& result) {
  state_->update_map();
  state_->count_map(result);
  state_->clock.stamp(result, OdometryStage::kMapped);
}

Odometry::State::State(const OdometryConfig& configuration, ClockFunction clock_function)
    : config(configuration),
      clock{clock_function},
      threads{tbb::task_arena(config.threads)},
      budget(config.budget, clock_function),
      preprocessing(config),
      motion(config),
      map(config, info_of(config.registration).needs_points),
      ndt_icp(config, budget, clock),
      search(config, ndt_icp, budget),
      gate(config, ndt_icp.method()),
      initial_motions(config.max_filtered_points) {}

OdometryResult Odometry::State::result_for(const Scan& scan) {
  OdometryResult result;
  result.sequence = scan.sequence;
  result.scan_start = scan.start;
  result.scan_end = scan.end;
  return result;
}

/// Time for a recovery, which tries hypotheses that tracking does not need; zero while tracking. Half of the
/// time to the next scan keeps up with the scans.
Duration Odometry::State::recovery_budget(const Scan& scan) const {
  const bool is_due = !motion.is_initialising() && (gate.last_failed() || motion.is_behind_gap(scan));
  return is_due ? Duration::from_seconds(kRecoveryShare * motion.period_s()) : Duration{};
}

std::size_t Odometry::State::filter_points(const Scan& scan, OdometryResult& result) {
  // Methods that register against points need all of them.
  const std::size_t most = ndt_icp.method().needs_points ? scan.points.size() : config.scan_points;
  const std::size_t visited = budget.choose_scan_points(std::min(most, scan.points.size()));
  const float voxel_share = motion.scans() == 0        ? kFirstVoxelShare
                            : motion.is_initialising() ? kInitialVoxelShare
                                                       : 1.0F;
  preprocessing.filter(scan, visited, voxel_share);
  result.points = static_cast<std::uint32_t>(scan.points.size());
  result.points_filtered = static_cast<std::uint32_t>(preprocessing.sweep().size());
  return visited;
}

bool Odometry::State::restart_is_due() const {
  return gate.restart_is_due(motion) && preprocessing.sweep().size() >= kMinStartPoints;
}

/// The first scan of a map.
void Odometry::State::start(const Scan& scan, OdometryResult& result) {
  if (initial_motions.sweeps().empty()) motion.level(scan);
  const Matrix6 covariance = motion.start(scan);
  map.drift().take(motion.T_map_base(), covariance);
  map.drift().follow(motion.T_map_base(), Matrix6::Identity(), Matrix6::Zero());
  alignment = {};
  initial_motions.begin(preprocessing.sweep(), motion.prior().span);
  const double plane_voxel_m = plane_voxel_for(config, scan.beam_spacing_rad);
  gate.begin_map(plane_voxel_m);
  place_first_sweep(plane_voxel_m);
  result.stop_reason = StopReason::kConverged;
  for (const auto stage : {OdometryStage::kFiltered, OdometryStage::kCoarse, OdometryStage::kFine})
    clock.stamp(result, stage);
}

/// The map is that of the first sweep, with the velocity known by now.
void Odometry::State::place_first_sweep(double plane_voxel_m) {
  motion.place_first_sweep(initial_motions.first_span());
  const PlacedSweep placed{motion.motion(), motion.T_map_last_middle()};
  initial_motions.place_first(placed);
  map.reset(plane_voxel_m);
  insert(initial_motions.sweeps().front(), placed);
}

void Odometry::State::insert(const std::vector<SweepPoint>& sweep, const PlacedSweep& placed) {
  const auto& points = preprocessing.deskew(sweep, placed.motion);
  map.insert(sweep, points, placed.T_map_middle, coarse_voxel_m());
}

void Odometry::State::predict(const Scan& scan, OdometryResult& result) {
  motion.predict(scan);
  result.imu_used = motion.prior().inputs.gyro;
  // The second scan first determines the initial velocity, then selects points.
  if (motion.scans() > 1) select_points(motion.T_predicted());
}

void Odometry::State::select_points(const SE3& T_map_guess) {
  ndt_icp.select(preprocessing.sweep(), motion.motion(), map, T_map_guess, gate.coarse_is_due(motion));
}

/// Threads of this registration.
tbb::task_arena& Odometry::State::registration_threads() {
  const bool is_little =
      motion.scans() > 1 && !gate.coarse_is_due(motion) && gate.is_tracking() &&
      static_cast<std::size_t>(alignment.fine_iterations) * ndt_icp.selected() < kMinSharedWork;
  return is_little ? threads.one : threads.all;
}

void Odometry::State::register_sweep(OdometryResult& result) {
  register_predicted(result);
  if (preprocessing.sweep().empty() || alignment.had_no_time()) return;
  reconsider_stationary(result);
  if (motion.is_initialising() || motion.prior().is_stationary) return;
  reconsider_imu(result);
  if (gate.is_doubtful(alignment, motion)) compare_hypotheses(result);
}

void Odometry::State::register_predicted(OdometryResult& result) {
  if (!initial_motions.are_decided()) return follow_initial_motions(result);
  if (motion.scans() > 1) return align_to_prediction(result);
  if (!motion.motion_goes_on()) return find_initial_motions(result);
  register_at_prediction(result);
  // Too few points tell nothing.
  if (!alignment.has_pose()) return;
  if (motion.fits(alignment.registration) && gate.begins_in_family(alignment, motion)) return;
  motion.forget_motion();
  find_initial_motions(result);
}

void Odometry::State::register_at_prediction(OdometryResult& result) {
  select_points(motion.T_predicted());
  align_to_prediction(result);
}

void Odometry::State::align_to_prediction(OdometryResult& result) {
  align({motion.T_predicted(), metric_of(motion.filter()), gate.coarse_is_due(motion)}, result);
}

void Odometry::State::align(const AlignmentStart& start, OdometryResult& result) {
  alignment = ndt_icp.align(map, motion, start, result);
  alignment.count(result);
}

void Odometry::State::check_alignment(OdometryResult& result) {
  const RegistrationResult& registration = alignment.registration;
  result.stop_reason = registration.stop_reason;
  if (gate.accepts(alignment, motion)) {
    result.state = gate.accept(alignment, motion);
    result.degenerate_axes = registration.degenerate_axes;
    result.predicted = registration.equations.correspondences == 0;
    const Matrix6 predicted = motion.filter().pose_covariance();
    map.drift().follow(registration.T_map_moving, share_of_newest_scan(registration, predicted),
                       gain_of(predicted, registration.information));
    alignment.relocalized ? motion.relocate(registration) : motion.update(registration);
    if (!motion.prior().motion_compensated) result.deskew_rate = motion.filter().state().angular_velocity;
  } else {
    result.predicted = true;
    if (alignment.has_converged())
      result.stop_reason = StopReason::kDegenerate;
    else if (preprocessing.sweep().empty() && budget.was_short())
      result.stop_reason = StopReason::kBudget;
    // A budget too small for tracking is no reason to exceed it.
    const bool for_lack_of_time = result.stop_reason == StopReason::kBudget && result.recovery_budget.ns == 0;
    result.state = gate.fail(alignment, motion, for_lack_of_time);
    motion.coast();
  }
  alignment.awaits_map = true;
}

void Odometry::State::finish(OdometryResult& result) {
  count_map(result);
  result.degradation_level = degradation_level_of(result);
  alignment.fine_iterations = result.fine_iterations;
  const PublishedPose pose =
      describe(motion.prior(), motion.filter(), motion.motion(), motion.T_map_base(), result);
  gate.publish(pose, result.state);
  motion.finish(alignment.registration.degenerate_axes);
}

PublishedPose Odometry::State::describe(const MotionPrior& prior, const MotionFilter& at_middle,
                                        const SweepMotion& moved, const SE3& T_map_base,
                                        OdometryResult& result) const {
  result.T_odom_base = motion.T_odom_map() * T_map_base;
  result.T_odom_base_middle = result.T_odom_base * moved.T_middle_end().inverse();
  result.twist = moved.end_twist();
  result.gyro_bias = at_middle.state().gyro_bias;
  result.accelerometer_bias = at_middle.state().accelerometer_bias;
  result.gravity = motion.T_odom_map().rotation * at_middle.state().gravity;
  result.accelerometer_used = prior.inputs.measure_motion();
  result.imu_time_shift = motion.monitor().time_shift();
  MotionFilter at_end = at_middle;
  at_end.propagate(prior.inputs, moved.span().end);
  const Matrix6 to_odom = block_rotation(result.T_odom_base.rotation.toRotationMatrix());
  result.pose_covariance = to_odom * at_end.pose_covariance() * to_odom.transpose();
  const Matrix6 since_start = at_end.levelled_pose_covariance() + map.drift().at(T_map_base);
  result.drift_covariance = to_odom * since_start * to_odom.transpose();
  result.twist_covariance = at_end.twist_covariance();
  const PublishedPose pose{T_map_base, moved.span().end, prior.span_s(), result.twist.head<3>().norm(),
                           at_middle.pose_covariance()};
  result.state = gate.published_state(pose, result.state);
  return pose;
}

DegradationLevel Odometry::State::degradation_level_of(const OdometryResult& result) const {
  if (!budget.was_short()) return DegradationLevel::kFull;
  const bool has_coarse = result.coarse_iterations > 0;
  if (result.fine_iterations == 0)
    return has_coarse ? DegradationLevel::kNdtOnly : DegradationLevel::kPredictionOnly;
  return alignment.with_coarse && !has_coarse ? DegradationLevel::kIcpOnly : DegradationLevel::kFewerPoints;
}

void Odometry::State::count_map(OdometryResult& result) const {
  result.map_voxels = static_cast<std::uint32_t>(map.planes().size());
  result.map_refused = map.refused();
}

float Odometry::State::coarse_voxel_m() const {
  return kCoarseVoxelMetres * (preprocessing.is_dense() ? kInitialVoxelShare : 1.0F);
}

/// The map takes the last scan, unless it is in doubt or shows nothing new.
void Odometry::State::update_map() {
  if (!std::exchange(alignment.awaits_map, false)) return;
  const std::vector<SweepPoint>& sweep = preprocessing.sweep();
  tbb::task_arena& arena = sweep.size() < kMinSharedPoints ? threads.one : threads.all;
  arena.execute([&] {
    const MotionState& state = motion.filter().state();
    const bool is_observed = alignment.registration.degenerate_axes == 0 && !motion.prior().is_stationary;
    if (config.calibrate_beams && gate.vouches() && is_observed && motion.scans() > kInitialScans)
      ndt_icp.add_residuals(map, motion, alignment, config.T_base_lidar, preprocessing.beam_calibration());
    const bool is_new = !is_stationary(state.twist()) && map.is_elsewhere(state.T_map_base);
    const auto& points = preprocessing.deskew(sweep, motion.motion());
    if (gate.vouches() && (preprocessing.is_dense() || is_new)) {
      map.insert(sweep, points, state.T_map_base, coarse_voxel_m());
      map.drift().take(state.T_map_base, motion.filter().pose_covariance());
    }
    preprocessing.move_deskewed(motion.motion().T_middle_end().inverse());
    map.evict_far_from(motion.T_map_base().translation);
  });
}

}  // namespace nilio::core
