#include "nilio/daemon/pipeline.hpp"

#include "nilio/daemon/config_terms.hpp"

#include <algorithm>
#include <future>
#include <utility>

namespace nilio::daemon {

namespace {

using core::Error;
using core::Result;

// 4096 packets: 1.2 s of an HDL-64E, 5.4 s of a VLP-16. 4096 samples: 10 s at 400 Hz. Poses: more than a
// minute.
constexpr std::size_t kPacketSlots = 4096;
constexpr std::size_t kSampleSlots = 4096;
constexpr std::size_t kPoseSlots = 256;
constexpr std::size_t kCloudSlots = 64;
constexpr std::size_t kHealthSlots = 256;
// Of the budget, that a scan waits for its IMU samples at most.
constexpr double kImuWaitShare = 0.3;
// Time for all threads to be up before the first packet of a paced recording is due.
constexpr std::int64_t kPaceLeadNs = 100'000'000;

}  // namespace

LidarLane::LidarLane(const std::string& section, const LidarConfig& config,
                     const drivers::ScanAssemblerConfig& assembler, drivers::PacketSource& packet_source,
                     const std::optional<drivers::VelodyneSensor>& sensor, FeedLog& log)
    : source(packet_source),
      ring(ipc::Ring<drivers::Packet>::in_private_memory(kPacketSlots)),
      channel(section, config, assembler, sensor, ring, state, log) {}

Result<std::unique_ptr<Pipeline>> Pipeline::create(const Config& config, Input input,
                                                   const PipelineOptions& options,
                                                   ipc::PublisherProcess* publisher) {
  Result<ipc::WakeEvent> data_event = ipc::WakeEvent::create();
  if (!data_event) return data_event.error();
  Result<ipc::WakeEvent> output_event = ipc::WakeEvent::create();
  if (!output_event) return output_event.error();
  std::unique_ptr<Pipeline> pipeline(new Pipeline(config, std::move(input), options, publisher,
                                                  std::move(data_event).value(),
                                                  std::move(output_event).value()));
  if (pipeline->live_rules_ && pipeline->budget_.mode == core::BudgetMode::kWall) {
    auto guard = DeadlineGuard::create([publisher](const ipc::PoseRecord& record) {
      if (publisher != nullptr) publisher->publish(record);
    });
    if (!guard) return guard.error();
    pipeline->guard_ = std::move(guard).value();
  }
  return pipeline;
}

Pipeline::Pipeline(const Config& config, Input input, const PipelineOptions& options,
                   ipc::PublisherProcess* publisher, ipc::WakeEvent data_event, ipc::WakeEvent output_event)
    : config_(config),
      input_(std::move(input)),
      options_(options),
      live_rules_(input_.live || options.as_live),
      budget_(budget_config(config.odometry, live_rules_)),
      publisher_(publisher),
      plan_(make_thread_plan(config.realtime, live_rules_)),
      imu_ring_(ipc::Ring<core::ImuSample>::in_private_memory(kSampleSlots)),
      poses_(ipc::Ring<ipc::PoseRecord>::in_private_memory(kPoseSlots)),
      clouds_(ipc::Ring<CloudRecord>::in_private_memory(kCloudSlots)),
      imu_health_(ipc::Ring<core::ImuHealth>::in_private_memory(kHealthSlots)),
      decisions_(ipc::Ring<ScanDecision>::in_private_memory(kPoseSlots)),
      data_event_(std::move(data_event)),
      output_event_(std::move(output_event)) {
  policy_.wait_when_full = !live_rules_;
  make_feed();
}

void Pipeline::make_feed() {
  if (!input_.packets) {
    feed_ = input_.scans.get();
    return;
  }
  lidars_.push_back(std::make_unique<LidarLane>("lidar", config_.lidar, assembler_config(config_.lidar),
                                                *input_.packets, input_.sensor, feed_log_));
  packet_feed_ = std::make_unique<PacketScanFeed>(lidars_.front()->channel, data_event_);
  feed_ = packet_feed_.get();
  if (!input_.more_lidars.empty()) make_merged_feed();
}

void Pipeline::make_merged_feed() {
  const core::SE3 T_first_base = to_transform(config_.lidar.extrinsic).inverse();
  std::vector<MergedScanFeed::Other> others;
  for (const ExtraLidar& lidar : input_.more_lidars) {
    // Its scans are only the vehicle of its points: where they are cut and what they cover is of no account.
    drivers::ScanAssemblerConfig assembler = assembler_config(lidar.config);
    assembler.min_coverage = 0.0;
    lidars_.push_back(std::make_unique<LidarLane>(lidar.section, lidar.config, assembler, *lidar.packets,
                                                  lidar.sensor, feed_log_));
    others.push_back({&lidars_.back()->channel, T_first_base * to_transform(lidar.config.extrinsic),
                      elevation_correction_rad(lidar.config),
                      core::Duration::from_milliseconds(lidar.config.wait_ms)});
  }
  const MergedScanFeed::Options options{live_rules_, elevation_correction_rad(config_.lidar)};
  merged_feed_ =
      std::make_unique<MergedScanFeed>(*packet_feed_, std::move(others), options, data_event_, feed_log_);
  feed_ = merged_feed_.get();
}

Pipeline::~Pipeline() {
  request_stop();
  join();
}

drivers::ImuDecoderStats Pipeline::imu_stats() const {
  return input_.imu_decoder ? input_.imu_decoder->stats() : drivers::ImuDecoderStats{};
}

std::uint64_t Pipeline::packets_dropped() const {
  std::uint64_t dropped = 0;
  for (const auto& lidar : lidars_) dropped += lidar->ring.dropped();
  return dropped;
}

OdometryLoopConfig Pipeline::loop_config() const {
  OdometryLoopConfig result;
  result.lossless = !live_rules_;
  result.imu_wait = core::Duration::from_milliseconds(config_.odometry.imu_wait_ms);
  // Registration has to have most of the time.
  if (budget_.mode == core::BudgetMode::kWall)
    result.imu_wait = std::min(
        result.imu_wait,
        core::Duration{static_cast<std::int64_t>(kImuWaitShare * static_cast<double>(budget_.budget.ns))});
  if (!options_.decisions.empty()) result.decisions = &options_.decisions;
  return result;
}

void Pipeline::odometry_body() {
  OdometryOutputs outputs;
  outputs.poses = &poses_;
  outputs.clouds = options_.collect_map ? &clouds_ : nullptr;
  outputs.event = &output_event_;
  outputs.publisher = publisher_;
  outputs.observer = options_.observer;
  const bool with_imu = input_.frames != nullptr;
  outputs.imu_health = with_imu ? &imu_health_ : nullptr;
  outputs.decisions = live_rules_ ? &decisions_ : nullptr;
  outputs.guard = guard_.get();
  core::OdometryConfig odometry = odometry_config(config_);
  odometry.budget = budget_;
  // Merged scans come corrected: each LiDAR's beams are raised about its own centre.
  if (merged_feed_) odometry.elevation_correction_rad = 0.0F;
  // Made in this thread, so that the arena's workers inherit its scheduling.
  OdometryLoop loop(core::Odometry(odometry, options_.clock), *feed_, with_imu ? &imu_ring_ : nullptr,
                    data_event_, with_imu ? &imu_state_ : nullptr, outputs, loop_config());
  loop.run(stop_, counters_);
  if (guard_) guard_->stop();
  finished_.store(true, std::memory_order_release);
  output_event_.notify();
}

void Pipeline::run_thread(ThreadRole role, std::function<void()> body, std::vector<PlanOutcome>& outcomes) {
  std::promise<PlanOutcome> granted;
  std::future<PlanOutcome> outcome = granted.get_future();
  threads_.emplace_back([this, role, body = std::move(body), granted = std::move(granted)]() mutable {
    PlanOutcome result = apply_to_this_thread(plan_, role);
    const bool run = result.granted || !plan_.strict;
    granted.set_value(std::move(result));
    if (run) body();
  });
  outcomes.push_back(outcome.get());
}

Result<std::vector<PlanOutcome>> Pipeline::start() {
  std::vector<PlanOutcome> outcomes{lock_process_memory(plan_)};
  if (options_.paced && input_.first_stamp) {
    policy_.pace = Pace{*input_.first_stamp, monotonic_ns() + kPaceLeadNs};
  } else if (options_.paced) {
    feed_->set_pace(monotonic_ns() + kPaceLeadNs);
  }
  if (guard_)
    run_thread(
        ThreadRole::kDeadlineGuard, [this] { guard_->run(); }, outcomes);
  run_thread(
      ThreadRole::kOdometry, [this] { odometry_body(); }, outcomes);
  for (const auto& lane : lidars_) {
    LidarLane& lidar = *lane;
    const auto receive = [this, &lidar] {
      receive_packets(lidar.source, lidar.ring, data_event_, policy_, lidar.state);
    };
    run_thread(ThreadRole::kLidarReceive, receive, outcomes);
  }
  if (input_.frames) {
    // A recording played as fast as possible has samples seconds before the scans they belong to.
    ipc::PublisherProcess* const imu_poses = input_.live || policy_.pace ? publisher_ : nullptr;
    const auto receive = [this, imu_poses] {
      receive_imu(*input_.frames, *input_.imu_decoder, imu_ring_, data_event_, policy_, imu_state_,
                  imu_poses);
    };
    run_thread(ThreadRole::kImuReceive, receive, outcomes);
  }
  for (const PlanOutcome& outcome : outcomes) {
    if (outcome.granted || !plan_.strict) continue;
    request_stop();
    join();
    return Error{"realtime.strict is set and " + outcome.text};
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
  for (std::thread& thread : threads_) thread.join();
  threads_.clear();
}

}  // namespace nilio::daemon
