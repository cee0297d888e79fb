#include "daemon/odometry/odometry_loop.hpp"

#include <algorithm>
#include <ctime>
#include <utility>

namespace nilio::daemon {

namespace {

using core::Duration;

constexpr Duration kFeedTimeout = Duration::from_milliseconds(50.0);
constexpr Duration kImuPoll = Duration::from_milliseconds(2.0);
// Replay: time in which a mapper that was killed has been restarted and has read a keyframe.
constexpr Duration kMapperPatience = Duration::from_seconds(20.0);

void copy_row_major(const core::Matrix6& matrix, std::array<double, 36>& output) {
  for (int row = 0; row < 6; ++row) {
    for (int column = 0; column < 6; ++column)
      output[static_cast<std::size_t>(6 * row + column)] = matrix(row, column);
  }
}

std::int64_t& stage_of(ipc::PoseRecord& record, ipc::Stage stage) {
  return record.stage_ns[static_cast<std::size_t>(stage)];
}

/// Arrival time of the scan; now, if its packets have no receive times.
std::int64_t arrival_ns(const core::Scan& scan) {
  return scan.received_ns > 0 ? scan.received_ns : monotonic_ns();
}

bool has_same_states(const core::ImuHealth& a, const core::ImuHealth& b) {
  const auto same_state = [](const core::ImuDiagnosis& x, const core::ImuDiagnosis& y) {
    return x.state == y.state;
  };
  return a.trusted == b.trusted && a.reason == b.reason && a.time_shift_ms == b.time_shift_ms &&
         std::equal(a.rows.begin(), a.rows.end(), b.rows.begin(), same_state);
}

}  // namespace

ipc::PoseRecord make_pose_record(const core::OdometryResult& result, const core::Scan& scan) {
  ipc::PoseRecord record;
  record.sequence = result.sequence;
  record.stamp_ns = result.scan_end.ns;
  record.scan_start_ns = result.scan_start.ns;
  for (Eigen::Index i = 0; i < 3; ++i) {
    const auto k = static_cast<std::size_t>(i);
    record.position[k] = result.T_odom_base.translation[i];
    record.middle_position[k] = result.T_odom_base_middle.translation[i];
    record.linear_velocity[k] = result.twist[i];
    record.angular_velocity[k] = result.twist[i + 3];
    record.deskew_rate[k] = result.deskew_rate[i];
    record.gyro_bias[k] = result.gyro_bias[i];
    record.accelerometer_bias[k] = result.accelerometer_bias[i];
    record.gravity[k] = result.gravity[i];
  }
  record.orientation_xyzw = core::xyzw(result.T_odom_base.rotation);
  record.middle_orientation_xyzw = core::xyzw(result.T_odom_base_middle.rotation);
  copy_row_major(result.pose_covariance, record.pose_covariance);
  copy_row_major(result.drift_covariance, record.drift_covariance);
  copy_row_major(result.twist_covariance, record.twist_covariance);
  record.state = result.state;
  record.stop_reason = result.stop_reason;
  record.imu_time_shift_ns = result.imu_time_shift.ns;
  record.imu_used = result.imu_used;
  record.accelerometer_used = result.accelerometer_used;
  record.predicted = result.predicted;
  record.degenerate_axes = result.degenerate_axes;
  record.degradation_level = result.degradation_level;
  record.recovery_budget = result.recovery_budget.ns > 0;
  record.coarse_iterations = static_cast<std::uint16_t>(std::min(result.coarse_iterations, 65535));
  record.fine_iterations = static_cast<std::uint16_t>(std::min(result.fine_iterations, 65535));
  record.points = result.points;
  record.points_used = result.points_used;
  record.correspondences = result.correspondences;
  record.map_voxels = result.map_voxels;
  record.lost_packets = scan.lost_packets;
  record.missing_firings = scan.missing_firings;
  record.coverage_deg = scan.coverage_deg;
  record.clock_source = scan.clock_source;
  record.after_time_jump = scan.after_time_jump;
  stage_of(record, ipc::Stage::kReceived) = scan.received_ns;
  stage_of(record, ipc::Stage::kPopped) = scan.popped_ns;
  stage_of(record, ipc::Stage::kCompleted) = scan.completed_ns;
  stage_of(record, ipc::Stage::kStarted) = result.stage_time_ns(core::OdometryStage::kStarted);
  stage_of(record, ipc::Stage::kFiltered) = result.stage_time_ns(core::OdometryStage::kFiltered);
  stage_of(record, ipc::Stage::kCoarse) = result.stage_time_ns(core::OdometryStage::kCoarse);
  stage_of(record, ipc::Stage::kFine) = result.stage_time_ns(core::OdometryStage::kFine);
  return record;
}

OdometryLoop::OdometryLoop(core::Odometry odometry, ScanFeed& feed, ipc::Ring<core::ImuSample>* imu_ring,
                           ipc::WakeEvent& data_event, ReceiveState* imu_state,
                           const OdometryOutputs& outputs, const OdometryLoopConfig& config)
    : odometry_(std::move(odometry)),
      feed_(feed),
      imu_ring_(imu_ring),
      data_event_(data_event),
      imu_state_(imu_state),
      outputs_(outputs),
      config_(config),
      cloud_feed_(outputs.publisher, outputs.mapper) {}

bool OdometryLoop::run(const std::atomic<bool>& stop, OdometryCounters& counters) {
  if (stop.load(std::memory_order_relaxed)) return false;
  const FeedState state = feed_.next(scan_, kFeedTimeout);
  if (state != FeedState::kScan) return state == FeedState::kIdle;
  counters.scans.fetch_add(1, std::memory_order_relaxed);
  scan_.after_time_jump |= std::exchange(skipped_time_jump_, false);
  scan_.clock_step = scan_.clock_step + std::exchange(skipped_clock_step_, {});
  if (config_.decisions == nullptr) {
    process(scan_, stop, counters);
  } else if (!repeat(scan_, stop, counters)) {
    return false;
  }
  report_warm(counters);
  return true;
}

void OdometryLoop::report_warm(const OdometryCounters& counters) {
  if (config_.hook == nullptr || warm_reported_ ||
      counters.poses.load(std::memory_order_relaxed) < kWarmUpPoses)
    return;
  warm_reported_ = true;
  config_.hook(ThreadRole::kOdometry, ThreadPhase::kWarm);
}

/// The next scan takes over what the skipped one says about clocks that were set.
void OdometryLoop::supersede(const core::Scan& scan, OdometryCounters& counters) {
  counters.superseded.fetch_add(1, std::memory_order_relaxed);
  skipped_time_jump_ = scan.after_time_jump;
  skipped_clock_step_ = scan.clock_step;
}

void OdometryLoop::process(const core::Scan& scan, const std::atomic<bool>& stop,
                           OdometryCounters& counters) {
  // A queue of scans is worse than a missing one: live, the newest complete scan wins.
  if (config_.rules.are_live() && feed_.waiting_scans() > 0) {
    supersede(scan, counters);
    push_decision(scan, true, false);
    return;
  }
  wait_for_imu(scan, stop, counters);
  register_and_publish(scan, nullptr, stop, counters);
}

/// Returns false at the end of the decision log.
bool OdometryLoop::repeat(const core::Scan& scan, const std::atomic<bool>& stop, OdometryCounters& counters) {
  const std::vector<ScanDecision>& decisions = *config_.decisions;
  while (next_decision_ < decisions.size() && decisions[next_decision_].sequence < scan.sequence) {
    counters.decisions_missed.fetch_add(1, std::memory_order_relaxed);
    ++next_decision_;
  }
  if (next_decision_ == decisions.size()) return false;
  if (decisions[next_decision_].sequence > scan.sequence) {
    counters.decisions_missed.fetch_add(1, std::memory_order_relaxed);
    return true;
  }
  const ScanDecision& decision = decisions[next_decision_++];
  if (decision.superseded) {
    supersede(scan, counters);
    return true;
  }
  take_imu_samples(decision.imu_samples, stop, counters);
  register_and_publish(scan, &decision, stop, counters);
  return true;
}

bool OdometryLoop::take_imu_sample(OdometryCounters& counters) {
  const std::optional<core::ImuSample> sample = imu_ring_->try_pop();
  if (!sample) return false;
  ++imu_samples_taken_;
  sample_period_.add(sample->stamp);
  auto& counter = odometry_.add_imu(*sample) ? counters.imu_samples : counters.imu_refused;
  counter.fetch_add(1, std::memory_order_relaxed);
  return true;
}

void OdometryLoop::take_imu_samples(std::uint64_t count, const std::atomic<bool>& stop,
                                    OdometryCounters& counters) {
  while (imu_ring_ != nullptr && imu_samples_taken_ < count && !stop.load(std::memory_order_relaxed)) {
    const bool ended = imu_state_->ended.load(std::memory_order_acquire);
    if (take_imu_sample(counters)) continue;
    const Advance advanced = config_.has_lidar_imu ? feed_.advance() : Advance::kNothing;
    if (advanced == Advance::kDecoded) continue;
    if (ended || advanced == Advance::kScan) return;
    wait_for_samples(kImuPoll);
  }
}

/// Samples of a CAN IMU wake this thread only while it waits for them.
void OdometryLoop::wait_for_samples(Duration timeout) {
  imu_state_->is_awaited.store(true, std::memory_order_seq_cst);
  if (imu_ring_->size() == 0) data_event_.wait(timeout);
  imu_state_->is_awaited.store(false, std::memory_order_relaxed);
}

bool OdometryLoop::drain_imu(core::Time end, OdometryCounters& counters) {
  // Stops at the first sample that covers the scan, so that the odometry's input depends on the data only.
  while (!runtime_.latest_imu() || *runtime_.latest_imu() < end) {
    if (!take_imu_sample(counters)) return false;
  }
  return true;
}

/// True if the sample that covers the scan can arrive in time, by the sample period. The scan's last packet
/// arrives at its end. Waiting for a sample that cannot arrive in time only costs registration time.
bool OdometryLoop::imu_can_arrive(const core::Scan& scan, std::int64_t deadline) const {
  const std::optional<core::Time> latest = runtime_.latest_imu();
  if (!latest || scan.received_ns == 0) return true;
  const std::optional<Duration> due = sample_period_.due_after(scan.end, *latest);
  return !due || scan.received_ns + due->ns <= deadline;
}

void OdometryLoop::wait_for_imu(const core::Scan& scan, const std::atomic<bool>& stop,
                                OdometryCounters& counters) {
  if (imu_ring_ == nullptr) return;
  const std::int64_t deadline = arrival_ns(scan) + config_.imu_wait.ns;
  while (!stop.load(std::memory_order_relaxed)) {
    const bool ended = imu_state_->ended.load(std::memory_order_acquire);
    if (drain_imu(scan.end, counters)) return;
    // Most LiDARs have no IMU, and one on CAN may not be identified yet: wait only for one that has sent.
    if (config_.may_lack_imu && imu_samples_taken_ == 0) return;
    const Advance advanced = config_.has_lidar_imu ? feed_.advance() : Advance::kNothing;
    if (advanced == Advance::kDecoded) continue;
    if (ended && advanced == Advance::kNothing) return;
    const std::int64_t left = deadline - monotonic_ns();
    const bool is_late = config_.rules.are_live() && (left <= 0 || !imu_can_arrive(scan, deadline));
    if (is_late || advanced == Advance::kScan) {
      counters.imu_timeouts.fetch_add(1, std::memory_order_relaxed);
      return;
    }
    wait_for_samples(config_.rules.are_live() ? std::min(kImuPoll, Duration{left}) : kImuPoll);
  }
}

template <class T>
void OdometryLoop::wait_for_room(const ipc::Ring<T>& ring, const std::atomic<bool>& stop) const {
  while (!config_.rules.are_live() && ring.size() == ring.capacity() && !stop.load()) {
    const timespec pause{0, 200'000};
    nanosleep(&pause, nullptr);
  }
}

/// Replay: the map gets every keyframe, unless the mapper does not work.
void OdometryLoop::wait_for_mapper(const core::OdometryResult& result, const std::atomic<bool>& stop) {
  if (config_.rules.are_live() || mapper_is_stuck_ || !cloud_feed_.is_keyframe(result)) return;
  const std::int64_t limit = monotonic_ns() + kMapperPatience.ns;
  while (!outputs_.mapper->has_room() && !stop.load()) {
    const timespec pause{0, 200'000};
    nanosleep(&pause, nullptr);
    if (monotonic_ns() < limit) continue;
    mapper_is_stuck_ = true;
    return;
  }
}

void OdometryLoop::push_cloud(const core::OdometryResult& result, const std::atomic<bool>& stop) {
  wait_for_room(*outputs_.clouds, stop);
  const std::vector<Eigen::Vector3f>& points = odometry_.deskewed_points();
  const std::span<CloudRecord> slot = outputs_.clouds->begin_write(1);
  if (slot.empty()) {
    outputs_.clouds->count_dropped(1);
    return;
  }
  CloudRecord& cloud = slot[0];
  cloud.stamp_ns = result.scan_end.ns;
  cloud.count = static_cast<std::uint32_t>(std::min(points.size(), CloudRecord::kCapacity));
  for (std::size_t i = 0; i < cloud.count; ++i) {
    const Eigen::Vector3f& p = points[i * points.size() / cloud.count];
    const core::Vector3 q = result.T_odom_base * p.cast<double>();
    cloud.points[i] = {static_cast<float>(q.x()), static_cast<float>(q.y()), static_cast<float>(q.z())};
  }
  outputs_.clouds->commit(1);
}

std::vector<core::BeamCorrection> OdometryLoop::beam_corrections() const {
  std::vector<core::BeamCorrection> corrections(core::kMaxCalibratedBeams);
  for (std::size_t ring = 0; ring < corrections.size(); ++ring)
    corrections[ring] = odometry_.beam_correction(ring);
  return corrections;
}

void OdometryLoop::push_imu_health(bool always) {
  const bool has_imu = !config_.has_lidar_imu || imu_samples_taken_ > 0;
  if (outputs_.imu_health == nullptr || !has_imu) return;
  const core::ImuHealth& health = odometry_.imu_health();
  if (!always && has_same_states(health, pushed_health_)) return;
  if (outputs_.imu_health->try_push(health)) pushed_health_ = health;
}

ipc::PoseRecord OdometryLoop::complete_record(const core::OdometryResult& result, const core::Scan& scan,
                                              const OdometryCounters& counters) {
  ipc::PoseRecord record = make_pose_record(result, scan);
  record.superseded = counters.superseded.load(std::memory_order_relaxed);
  record.has_imu = imu_ring_ != nullptr && (!config_.has_lidar_imu || imu_samples_taken_ > 0);
  if (record.has_imu) record.imu_health = odometry_.imu_health();
  return record;
}

void stamp_delivery(ipc::PoseRecord& record) {
  record.delivered_realtime_ns = clock_ns(CLOCK_REALTIME);
  stage_of(record, ipc::Stage::kDelivered) = monotonic_ns();
}

/// Publishes the record. Returns false if the guard was faster; `record` is then the guard's pose.
bool OdometryLoop::deliver(ipc::PoseRecord& record) {
  if (outputs_.guard != nullptr && !outputs_.guard->claim()) {
    record = outputs_.guard->published();
    return false;
  }
  stamp_delivery(record);
  const core::ComputeBudget& budget = runtime_.budget();
  record.has_deadline = budget.mode() != core::BudgetMode::kOff;
  record.overshoot_ns = budget.overshoot_ns();
  if (outputs_.publisher != nullptr) outputs_.publisher->publish(record);
  return true;
}

void OdometryLoop::push_pose(const ipc::PoseRecord& record, const std::atomic<bool>& stop) {
  if (outputs_.poses == nullptr) return;
  wait_for_room(*outputs_.poses, stop);
  outputs_.poses->try_push(record);
}

void OdometryLoop::push_decision(const core::Scan& scan, bool superseded, bool guarded) {
  if (outputs_.decisions == nullptr) return;
  ScanDecision decision{scan.sequence, superseded, guarded, imu_samples_taken_, {}, feed_.merge_decision()};
  if (!superseded) decision.budget = runtime_.budget().decisions();
  outputs_.decisions->try_push(decision);
}

/// Deposits the prediction with the guard.
void OdometryLoop::arm_guard(const core::OdometryResult& prediction, const core::Scan& scan,
                             const OdometryCounters& counters) {
  ipc::PoseRecord record = complete_record(prediction, scan, counters);
  record.guarded = true;
  // One iteration later than the deadline: a registration in its last iteration is better than a prediction.
  const std::int64_t deadline = arrival_ns(scan) + runtime_.budget().budget().ns;
  outputs_.guard->arm(record, deadline, deadline + runtime_.budget().iteration_ns());
}

void OdometryLoop::register_and_publish(const core::Scan& scan, const ScanDecision* decision,
                                        const std::atomic<bool>& stop, OdometryCounters& counters) {
  const bool repeats_guard = decision != nullptr && decision->guarded;
  core::OdometryResult prediction;
  if (outputs_.guard != nullptr || repeats_guard) prediction = runtime_.predict_pose(scan);
  if (outputs_.guard != nullptr) arm_guard(prediction, scan, counters);
  core::OdometryResult result =
      decision != nullptr ? runtime_.register_scan(scan, decision->budget) : odometry_.register_scan(scan);
  if (result.imu_used) counters.scans_with_imu.fetch_add(1, std::memory_order_relaxed);
  ipc::PoseRecord record = complete_record(repeats_guard ? prediction : result, scan, counters);
  record.guarded = repeats_guard;
  const bool guarded = !deliver(record);
  runtime_.note_published(result);
  push_decision(scan, false, guarded);
  // After the delivery of the pose, the map update has time until the next scan.
  odometry_.update_map(result);
  record.map_voxels = result.map_voxels;
  record.iteration_ns = runtime_.budget().iteration_ns();
  stage_of(record, ipc::Stage::kMapped) = result.stage_time_ns(core::OdometryStage::kMapped);
  push_pose(record, stop);
  wait_for_mapper(result, stop);
  cloud_feed_.add(result, odometry_);
  if (outputs_.clouds != nullptr) push_cloud(result, stop);
  push_imu_health(false);
  if (outputs_.observer) outputs_.observer(scan, result, odometry_);
  counters.poses.fetch_add(1, std::memory_order_relaxed);
  if (outputs_.event != nullptr) outputs_.event->notify();
}

}  // namespace nilio::daemon
