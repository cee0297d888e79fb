#include "daemon/odometry/pipeline.hpp"

#include "daemon/config/convert.hpp"
#include "daemon/realtime/memory_plan.hpp"
#include "ipc/kernel_requests.hpp"

#include <algorithm>
#include <atomic>
#include <bit>
#include <numbers>
#include <pthread.h>
#include <unistd.h>
#include <utility>

#include <tbb/global_control.h>

namespace nilio::daemon {

namespace {

using core::Error;
using core::Result;

// 4096 samples: 10 s at 400 Hz. 256 poses: 25 s at 10 Hz.
constexpr std::size_t kSampleSlots = 4096;
constexpr std::size_t kPoseSlots = 256;
constexpr std::size_t kCloudSlots = 64;
// Data of a recorded run that wait for the disk: 4.7 s of an HDL-64E, 5 s of a full CAN bus.
constexpr std::size_t kRecordedPackets = 16384;
constexpr std::size_t kRecordedFrames = 16384;
constexpr std::size_t kHealthSlots = 256;
// Maximum share of the budget that a scan waits for its IMU samples.
constexpr double kImuWaitShare = 0.3;
// Start-up time of the threads before the first packet of a paced recording is due.
constexpr std::int64_t kPaceLeadNs = 100'000'000;
// Above the maximum of odometry.threads.
constexpr std::size_t kMaxWorkers = 64;

/// Points of its longest scan. An unidentified LiDAR gets those of an HDL-64E; larger buffers grow during its
/// first scans.
std::size_t point_capacity(const ExtraLidar& lidar) {
  return drivers::scan_capacity(
      lidar.sensor ? *lidar.sensor : drivers::make_velodyne_sensor(drivers::VelodyneModel::kHdl64eS2));
}

/// The power of two nearest to one second of packets in the return mode with the most; for an unknown sensor
/// that of the VLS-128.
std::size_t packet_slots(const LidarConfig& config,
                         const std::optional<drivers::VelodyneSensor>& identified) {
  const drivers::VelodyneModel model =
      drivers::parse_velodyne_model(config.model).value_or(drivers::VelodyneModel::kVls128);
  const drivers::VelodyneSensor sensor = identified ? *identified : drivers::make_velodyne_sensor(model);
  std::int64_t period_ns = sensor.single().packet_period_ns;
  for (const drivers::PacketLayout& layout : sensor.layouts)
    period_ns = std::min(period_ns, layout.packet_period_ns);
  const double packets = 1e9 / static_cast<double>(period_ns);
  return std::bit_floor(static_cast<std::size_t>(packets * std::numbers::sqrt2));
}

}  // namespace

LidarInput::LidarInput(const std::string& section, const LidarConfig& config,
                       const drivers::ScanAssemblerConfig& assembler, drivers::PacketSource& packet_source,
                       const std::optional<drivers::VelodyneSensor>& sensor, EventLog& log)
    : source(packet_source),
      ring(ipc::Ring<drivers::Packet>::in_private_memory(packet_slots(config, sensor))),
      channel(section, config, assembler, sensor, ring, state, log) {}

Result<std::unique_ptr<Pipeline>> Pipeline::create(const Config& config, Input input,
                                                   const PipelineOptions& options,
                                                   ipc::PublisherProcess* publisher) {
  Result<ThreadPlan> plan = make_thread_plan(config, options.rules);
  if (!plan) return plan.error();
  Result<ipc::WakeEvent> data_event = ipc::WakeEvent::create();
  if (!data_event) return data_event.error();
  Result<ipc::WakeEvent> output_event = ipc::WakeEvent::create();
  if (!output_event) return output_event.error();
  std::unique_ptr<Pipeline> pipeline(new Pipeline(config, std::move(input), options, publisher,
                                                  std::move(plan).value(), std::move(data_event).value(),
                                                  std::move(output_event).value()));
  if (options.rules.are_live() && pipeline->budget_.mode == core::BudgetMode::kWall) {
    auto guard = DeadlineGuard::create([publisher](const ipc::PoseRecord& record) {
      if (publisher != nullptr) publisher->publish(record);
    });
    if (!guard) return guard.error();
    pipeline->guard_ = std::move(guard).value();
  }
  return pipeline;
}

Pipeline::Pipeline(const Config& config, Input input, const PipelineOptions& options,
                   ipc::PublisherProcess* publisher, ThreadPlan plan, ipc::WakeEvent data_event,
                   ipc::WakeEvent output_event)
    : config_(config),
      input_(std::move(input)),
      options_(options),
      budget_(budget_config(config.odometry, options.rules.are_live())),
      publisher_(publisher),
      plan_(std::move(plan)),
      imu_ring_(ipc::Ring<core::ImuSample>::in_private_memory(kSampleSlots)),
      poses_(ipc::Ring<ipc::PoseRecord>::in_private_memory(kPoseSlots)),
      clouds_(ipc::Ring<CloudRecord>::in_private_memory(kCloudSlots)),
      imu_health_(ipc::Ring<core::ImuHealth>::in_private_memory(kHealthSlots)),
      decisions_(ipc::Ring<ScanDecision>::in_private_memory(kPoseSlots)),
      data_event_(std::move(data_event)),
      output_event_(std::move(output_event)) {
  apply_extrinsics(input_, config_);
  policy_.rules = options_.rules;
  make_feed();
  if (!options_.record) return;
  for (const auto& lidar : lidars_)
    lidar->recorded = ipc::Ring<drivers::Packet>::in_private_memory(kRecordedPackets);
  if (input_.frames) recorded_frames_ = ipc::Ring<drivers::CanFrame>::in_private_memory(kRecordedFrames);
}

void Pipeline::make_feed() {
  if (!input_.packets) {
    feed_ = input_.scans.get();
    return;
  }
  drivers::ScanAssemblerConfig assembler = assembler_config(config_.lidar);
  for (const ExtraLidar& lidar : input_.more_lidars) assembler.more_points += point_capacity(lidar);
  lidars_.push_back(std::make_unique<LidarInput>("lidar", config_.lidar, assembler, *input_.packets,
                                                 input_.sensor, event_log_));
  if (options_.rules.has_sensors()) policy_.gather_until_ns = &gather_until_ns_;
  if (input_.has_lidar_imu)
    lidars_.front()->channel.use_own_imu(imu_ring_,
                                         core::Duration::from_milliseconds(config_.imu.time_offset_ms));
  packet_feed_ = std::make_unique<PacketScanFeed>(lidars_.front()->channel, data_event_, &gather_until_ns_);
  feed_ = packet_feed_.get();
  if (!input_.more_lidars.empty()) make_merged_feed();
}

void Pipeline::make_merged_feed() {
  const core::SE3 T_first_base = to_transform(config_.lidar.extrinsic).inverse();
  std::vector<MergedScanFeed::Other> others;
  for (const ExtraLidar& lidar : input_.more_lidars) {
    // Its scans only transport points: cut azimuth and coverage do not matter.
    drivers::ScanAssemblerConfig assembler = assembler_config(lidar.config);
    assembler.min_coverage = 0.0;
    lidars_.push_back(std::make_unique<LidarInput>(lidar.section, lidar.config, assembler, *lidar.packets,
                                                   lidar.sensor, event_log_));
    others.push_back({&lidars_.back()->channel, T_first_base * to_transform(lidar.config.extrinsic),
                      elevation_correction_rad(lidar.config),
                      core::Duration::from_milliseconds(lidar.config.wait_ms), point_capacity(lidar)});
  }
  const MergedScanFeed::Options options{options_.rules, elevation_correction_rad(config_.lidar),
                                        options_.decisions.empty() ? nullptr : &options_.decisions};
  merged_feed_ = std::make_unique<MergedScanFeed>(*packet_feed_, others, options, data_event_, event_log_);
  feed_ = merged_feed_.get();
}

Pipeline::~Pipeline() {
  request_stop();
  join();
}

drivers::ImuDecoderStats Pipeline::imu_stats() const {
  if (input_.has_lidar_imu && !lidars_.empty()) return lidars_.front()->channel.imu_stats();
  return input_.imu_decoder ? input_.imu_decoder->stats() : drivers::ImuDecoderStats{};
}

std::uint64_t Pipeline::packets_dropped() const {
  std::uint64_t dropped = 0;
  for (const auto& lidar : lidars_) dropped += lidar->ring.dropped();
  return dropped;
}

std::uint64_t Pipeline::foreign_packets() const {
  std::uint64_t foreign = 0;
  for (const auto& lidar : lidars_) foreign += lidar->channel.foreign_packets();
  return foreign;
}

OdometryLoopConfig Pipeline::loop_config() const {
  OdometryLoopConfig result;
  result.rules = options_.rules;
  result.has_lidar_imu = input_.has_lidar_imu;
  result.may_lack_imu = input_.has_lidar_imu || input_.imu_identification != nullptr;
  result.hook = options_.thread_hook;
  result.imu_wait = core::Duration::from_milliseconds(config_.odometry.imu_wait_ms);
  // Registration needs most of the budget.
  if (budget_.mode == core::BudgetMode::kWall)
    result.imu_wait = std::min(
        result.imu_wait,
        core::Duration{static_cast<std::int64_t>(kImuWaitShare * static_cast<double>(budget_.budget.ns))});
  if (!options_.decisions.empty()) result.decisions = &options_.decisions;
  return result;
}

std::unique_ptr<OdometryLoop> Pipeline::make_loop() {
  OdometryOutputs outputs;
  outputs.poses = &poses_;
  outputs.clouds = options_.collect_clouds ? &clouds_ : nullptr;
  outputs.event = &output_event_;
  outputs.publisher = publisher_;
  outputs.mapper = options_.mapper;
  outputs.observer = options_.observer;
  const bool with_imu = input_.frames != nullptr || input_.samples != nullptr || input_.has_lidar_imu;
  ReceiveState& imu_state = input_.has_lidar_imu ? lidars_.front()->state : imu_state_;
  outputs.imu_health = with_imu ? &imu_health_ : nullptr;
  outputs.decisions = options_.rules.are_live() ? &decisions_ : nullptr;
  outputs.guard = guard_.get();
  core::OdometryConfig odometry = odometry_config(config_);
  odometry.budget = budget_;
  if (input_.has_lidar_imu) odometry.T_base_imu = odometry.T_base_lidar;
  // Merged scans are already corrected: each LiDAR's beams are raised about its own centre. Errors of beams
  // refer to one centre.
  if (merged_feed_) {
    odometry.elevation_correction_rad = 0.0F;
    odometry.calibrate_beams = false;
  }
  return std::make_unique<OdometryLoop>(core::Odometry(odometry, options_.clock), *feed_,
                                        with_imu ? &imu_ring_ : nullptr, data_event_,
                                        with_imu ? &imu_state : nullptr, outputs, loop_config());
}

/// Starts the odometry's workers from the calling thread, whose scheduling they inherit. TBB may also reuse
/// workers from an earlier run in this process.
std::vector<PlanOutcome> Pipeline::warm_up(OdometryLoop& loop) {
  std::array<std::atomic<pid_t>, kMaxWorkers> threads{};
  std::atomic<std::size_t> count{0};
  const pid_t own = gettid();
  const ThreadScheduling scheduling = scheduling_of(0);
  loop.warm_up([&] {
    touch_stack();
    if (gettid() == own) return;
    run_as(scheduling);
    const std::size_t index = count.fetch_add(1);
    if (index < threads.size()) threads[index].store(gettid());
  });
  std::vector<pid_t> workers;
  for (std::size_t i = 0; i < std::min(count.load(), threads.size()); ++i)
    workers.push_back(threads[i].load());
  if (plan_.odometry_threads <= 1) return {};
  return {check_workers(plan_, workers)};
}

RealtimeWork Pipeline::odometry_work() {
  // Made and destroyed in the thread: it inherits its scheduling to the workers.
  struct Prepared {
    /// Stack size of the workers during their lifetime.
    tbb::global_control stacks{tbb::global_control::thread_stack_size, ipc::kThreadStackBytes};
    std::unique_ptr<OdometryLoop> loop;
  };
  const auto prepared = std::make_shared<std::unique_ptr<Prepared>>();
  RealtimeWork work;
  work.prepare = [this, prepared] {
    *prepared = std::make_unique<Prepared>();
    (*prepared)->loop = make_loop();
    return warm_up(*(*prepared)->loop);
  };
  work.run = [this, prepared] { return (*prepared)->loop->run(stop_, counters_); };
  work.finish = [this, prepared] {
    (*prepared)->loop->finish();
    beam_corrections_ = (*prepared)->loop->beam_corrections();
    if (guard_) guard_->stop();
    prepared->reset();
    finished_.store(true, std::memory_order_release);
    output_event_.notify();
  };
  return work;
}

void Pipeline::start_thread(ThreadRole role, RealtimeWork work, std::vector<PlanOutcome>& outcomes) {
  threads_.emplace_back(plan_, role, options_.thread_hook, std::move(work));
  for (PlanOutcome& outcome : threads_.back().await_start()) outcomes.push_back(std::move(outcome));
}

Result<std::vector<PlanOutcome>> Pipeline::start() {
  prepare_heap(plan_);
  std::vector<PlanOutcome> outcomes{lock_process_memory(plan_), check_throttling(plan_)};
  if (options_.rules.is_paced() && !input_.packets) feed_->set_pace(monotonic_ns() + kPaceLeadNs);
  start_thread(ThreadRole::kOdometry, odometry_work(), outcomes);
  if (guard_) start_thread(ThreadRole::kDeadlineGuard, {.run = [this] { return guard_->run(); }}, outcomes);
  if (options_.rules.is_paced() && input_.first_stamp)
    policy_.pace = Pace{*input_.first_stamp, monotonic_ns() + kPaceLeadNs};
  for (const auto& lidar : lidars_) {
    const auto receiver =
        std::make_shared<PacketReceiver>(lidar->source, lidar->ring, data_event_, policy_, lidar->state,
                                         lidar->recorded ? &*lidar->recorded : nullptr);
    start_thread(
        ThreadRole::kLidarReceive,
        {.run = [receiver] { return receiver->run(); }, .finish = [receiver] { receiver->finish(); }},
        outcomes);
  }
  // An unpaced replay has samples seconds before the scans they belong to.
  ipc::PublisherProcess* const imu_poses =
      options_.rules.has_sensors() || policy_.pace ? publisher_ : nullptr;
  if (input_.samples) {
    const auto receiver = std::make_shared<SampleReceiver>(*input_.samples, imu_ring_, data_event_, policy_,
                                                           imu_state_, imu_poses);
    start_thread(
        ThreadRole::kImuReceive,
        {.run = [receiver] { return receiver->run(); }, .finish = [receiver] { receiver->finish(); }},
        outcomes);
  }
  if (input_.frames) {
    const auto receiver = std::make_shared<ImuReceiver>(
        *input_.frames, input_.imu_decoder, input_.imu_identification.get(), imu_ring_, data_event_, policy_,
        imu_state_, imu_poses, recorded_frames());
    start_thread(
        ThreadRole::kImuReceive,
        {.run = [receiver] { return receiver->run(); }, .finish = [receiver] { receiver->finish(); }},
        outcomes);
  }
  for (const PlanOutcome& outcome : outcomes) {
    if (outcome.granted || !plan_.strict) continue;
    request_stop();
    join();
    return Error{"realtime.strict: " + outcome.text};
  }
  return outcomes;
}

void Pipeline::request_stop() {
  stop_.store(true);
  for (const auto& lidar : lidars_) lidar->state.stop.store(true);
  imu_state_.stop.store(true);
  data_event_.notify();
}

void Pipeline::join() {
  for (RealtimeThread& thread : threads_) thread.join();
  threads_.clear();
}

}  // namespace nilio::daemon
