#include "daemon/output/run_log.hpp"

#include "daemon/realtime/memory_plan.hpp"

#include <array>
#include <vector>

#include <nlohmann/json.hpp>
#include <spdlog/spdlog.h>

namespace nilio::daemon {

namespace {

/// Stages that do work; between the others a scan waits.
constexpr std::array kProcessingStages{ipc::LatencyStage::kFilter, ipc::LatencyStage::kCoarse,
                                       ipc::LatencyStage::kFine, ipc::LatencyStage::kDeliver,
                                       ipc::LatencyStage::kMap};

}  // namespace

void RunLog::add(const ipc::PoseRecord& record) {
  latency_.record(record);
  budget_.record(record);
  // Compares with the pose before.
  report_state(record);
  const ipc::OdometryReset reset = totals_.add(record);
  report_reset(record, reset);
}

/// Logs changes of the state and of the time source.
void RunLog::report_state(const ipc::PoseRecord& record) {
  if (record.state != reported_state_) {
    spdlog::info("scan {}: {} -> {} ({})", record.sequence, core::name_of(reported_state_),
                 core::name_of(record.state), core::name_of(record.stop_reason));
    reported_state_ = record.state;
  }
  if (totals_.last() && totals_.last()->clock_source == record.clock_source) return;
  spdlog::info("scan {}: LiDAR time source {}: {}", record.sequence, core::name_of(record.clock_source),
               describe_clock(record.clock_source));
}

/// Logs each discontinuity of map or pose with its reason, once.
void RunLog::report_reset(const ipc::PoseRecord& record, ipc::OdometryReset reset) const {
  using ipc::OdometryReset;
  const std::uint64_t poses = totals_.resets().poses_without_tracking();
  switch (reset) {
    case OdometryReset::kNone:
      return;
    case OdometryReset::kInitialisation:
      spdlog::warn(
          "scan {}: map reset: the first scans could not be registered to each other; initialisation "
          "starts again here",
          record.sequence);
      return;
    case OdometryReset::kNotRegistered:
    case OdometryReset::kNotRelocalised:
      spdlog::warn(
          "scan {}: map reset after {} poses without tracking: {}; the new map begins at the "
          "predicted pose, and poses before and after do not fit together",
          record.sequence, poses,
          reset == OdometryReset::kNotRegistered ? "no scan could be registered"
                                                 : "no place of the map was recognised");
      return;
    case OdometryReset::kRelocalised:
      spdlog::warn(
          "scan {}: relocalised in the map after {} poses without tracking: the pose jumps by {:.2f} m",
          record.sequence, poses, totals_.resets().step_m());
      return;
  }
}

void RunLog::add(const std::vector<PlanOutcome>& outcomes, bool live) {
  // Not of interest in a replay at normal priority.
  const auto good = live ? spdlog::level::info : spdlog::level::debug;
  for (const PlanOutcome& outcome : outcomes) {
    spdlog::log(outcome.granted && !outcome.warns ? good : spdlog::level::warn, "{}", outcome.text);
    plan_lines_.push_back(outcome.text);
  }
}

void RunLog::report_status() {
  const std::uint64_t poses = totals_.poses();
  if (poses == poses_at_last_status_) return;
  const ipc::PoseRecord& last = *totals_.last();
  spdlog::info("{}: {} poses (+{}), position {:.2f} {:.2f} {:.2f} m, {:.2f} m/s, {} correspondences{}",
               core::name_of(last.state), poses, poses - poses_at_last_status_, last.position[0],
               last.position[1], last.position[2], last.linear_velocity[0], last.correspondences,
               full_speed_ ? "" : ", latency p50 " + median_latency());
  poses_at_last_status_ = poses;
}

std::string RunLog::median_latency() const {
  const std::int64_t p50 = latency_.histogram(ipc::LatencyStage::kEndToEnd).snapshot().percentile(50.0);
  return fmt::format("{:.1f} ms", static_cast<double>(p50) * 1e-6);
}

void RunLog::report_stages() const {
  if (!full_speed_) {
    spdlog::info("latency by stage:\n{}", ipc::latency_table(latency_));
    return;
  }
  std::vector<ipc::LatencySummary> stages;
  for (const ipc::LatencyStage stage : kProcessingStages)
    stages.push_back(
        ipc::summarize(ipc::kLatencyStageNames[static_cast<std::size_t>(stage)], latency_.histogram(stage)));
  spdlog::info("processing time by stage (full speed; --speed real measures latency):\n{}",
               ipc::latency_table(stages));
}

nlohmann::json RunLog::summary(const Pipeline& pipeline) const {
  nlohmann::json json = pipeline_summary(pipeline);
  json["stages"] = ipc::latency_json(latency_);
  // At full speed the stages between the processing ones, and end_to_end, are waiting by intention.
  json["full_speed"] = full_speed_;
  json["counters"].update({
      {"poses", totals_.poses()},
      {"poses_initialising", totals_.count(ipc::TrackingState::kInitialising)},
      {"poses_tracking", totals_.count(ipc::TrackingState::kTracking)},
      {"poses_degraded", totals_.count(ipc::TrackingState::kDegraded)},
      {"poses_lost", totals_.count(ipc::TrackingState::kLost)},
  });
  json["imu"] = imu_.json();
  json["beams"] = beam_corrections_json(pipeline.beam_corrections());
  json["budget"] = budget_.json(pipeline.budget());
  json["budget"]["superseded"] = pipeline.counters().superseded.load();
  json["threads"] = plan_lines_;
  const MemoryUse memory = memory_use();
  json["memory"] = {{"resident_bytes", memory.resident_bytes},
                    {"peak_resident_bytes", memory.peak_resident_bytes},
                    {"locked_bytes", memory.locked_bytes}};
  if (totals_.last()) json["clock_source"] = core::name_of(totals_.last()->clock_source);
  json["path_length_m"] = totals_.path_length_m();
  return json;
}

RunOutput::FinalFiles RunLog::latency_files() const {
  RunOutput::FinalFiles files;
  for (std::size_t i = 0; i < ipc::kLatencyStageCount; ++i) {
    const auto stage = static_cast<ipc::LatencyStage>(i);
    files["latency/" + std::string(ipc::kLatencyStageNames[i]) + ".hgrm"] =
        ipc::percentile_distribution(latency_.histogram(stage).snapshot());
  }
  return files;
}

void RunLog::report_unused_imu(const Pipeline& pipeline) const {
  if (imu_.is_compared()) {
    spdlog::info(
        "IMU: compared with the LiDAR, but not used; it has not yet predicted a turn better than a constant "
        "rate");
    return;
  }
  spdlog::warn(
      "IMU: no scan covered ({} samples decoded) - check imu.preset, that both logs are of the same time, and "
      "that samples come more often than every odometry.max_imu_gap_ms",
      pipeline.counters().imu_samples.load());
}

void RunLog::report_end(const Pipeline& pipeline, double seconds) const {
  const OdometryCounters& counters = pipeline.counters();
  spdlog::info("{} scans, {} poses ({} initialising, {} tracking, {} degraded, {} lost) in {:.1f} s",
               counters.scans.load(), totals_.poses(), totals_.count(ipc::TrackingState::kInitialising),
               totals_.count(ipc::TrackingState::kTracking), totals_.count(ipc::TrackingState::kDegraded),
               totals_.count(ipc::TrackingState::kLost), seconds);
  const drivers::ScanAssemblerStats scans = pipeline.scan_stats();
  if (scans.lost_packets + scans.partial_scans + pipeline.packets_dropped() > 0) {
    spdlog::info("{} packets lost in the network, {} dropped by niliod, {} partial scans discarded",
                 scans.lost_packets, pipeline.packets_dropped(), scans.partial_scans);
  }
  log_merged_lidars(pipeline);
  const Input& input = pipeline.input();
  if (input.packets && input.packets->stats().malformed > 0) spdlog::warn("{}", input.packets->status());
  if (input.scans) {
    for (const std::string& line : input.scans->skipped()) spdlog::warn("{}", line);
  }
  if (input.samples && input.samples->stats().malformed > 0) spdlog::warn("{}", input.samples->status());
  if (input.frames) {
    if (input.frames->stats().malformed > 0) spdlog::warn("{}", input.frames->status());
    if (counters.scans_with_imu.load() == 0) report_unused_imu(pipeline);
  }
  if (const std::uint64_t jumps = pipeline.imu_stats().clock_jumps; jumps > 0)
    spdlog::warn(
        "IMU: its clock was set {} times; each time its samples were dated anew from the computer's clock",
        jumps);
  if (const std::string text = beam_corrections_text(pipeline.beam_corrections()); !text.empty())
    spdlog::info("{}", text);
  if (const std::string text = budget_.text(pipeline.budget()); !text.empty()) spdlog::info("{}", text);
  if (const std::uint64_t missed = counters.decisions_missed.load(); missed > 0)
    spdlog::warn(
        "{} scans do not match the decision log: it belongs to another recording, or to one with other lost "
        "packets; this run does not repeat it",
        missed);
  const MemoryUse memory = memory_use();
  spdlog::info("memory: {} MiB resident, {} MiB peak, {} MiB locked", memory.resident_bytes >> 20U,
               memory.peak_resident_bytes >> 20U, memory.locked_bytes >> 20U);
  report_stages();
}

}  // namespace nilio::daemon
