#include "daemon/output/run_log.hpp"

#include "daemon/realtime/memory_plan.hpp"

#include <Eigen/Core>
#include <nlohmann/json.hpp>
#include <spdlog/spdlog.h>

namespace nilio::daemon {

namespace {

Eigen::Vector3d position_of(const ipc::PoseRecord& record) {
  return {record.position[0], record.position[1], record.position[2]};
}

}  // namespace

void RunLog::add(const ipc::PoseRecord& record) {
  latency_.record(record);
  budget_.record(record);
  ++poses_;
  ++states_[static_cast<std::size_t>(record.state) % states_.size()];
  if (record.state != reported_state_) {
    spdlog::info("scan {}: {} -> {} ({})", record.sequence, core::name_of(reported_state_),
                 core::name_of(record.state), core::name_of(record.stop_reason));
    reported_state_ = record.state;
  }
  report_clock(record);
  if (last_) path_length_m_ += (position_of(record) - position_of(*last_)).norm();
  last_ = record;
}

void RunLog::add(const std::vector<PlanOutcome>& outcomes, bool live) {
  // Not of interest in a replay at normal priority.
  const auto good = live ? spdlog::level::info : spdlog::level::debug;
  for (const PlanOutcome& outcome : outcomes) {
    spdlog::log(outcome.granted && !outcome.warns ? good : spdlog::level::warn, "{}", outcome.text);
    plan_lines_.push_back(outcome.text);
  }
}

/// Logs the time source at the first scan and at every change.
void RunLog::report_clock(const ipc::PoseRecord& record) const {
  if (last_ && last_->clock_source == record.clock_source && !record.after_time_jump) return;
  if (record.after_time_jump)
    spdlog::warn("scan {}: the LiDAR's clock was set; its timeline is reset", record.sequence);
  spdlog::info("scan {}: LiDAR time source {}", record.sequence, core::name_of(record.clock_source));
}

void RunLog::report_status() {
  if (!last_ || poses_ == poses_at_last_status_) return;
  const auto p50 =
      static_cast<double>(latency_.histogram(ipc::LatencyStage::kEndToEnd).snapshot().percentile(50.0)) *
      1e-6;
  spdlog::info(
      "{}: {} poses (+{}), position {:.2f} {:.2f} {:.2f} m, {:.2f} m/s, {} correspondences, latency p50 "
      "{:.1f} ms",
      core::name_of(last_->state), poses_, poses_ - poses_at_last_status_, last_->position[0],
      last_->position[1], last_->position[2], last_->linear_velocity[0], last_->correspondences, p50);
  poses_at_last_status_ = poses_;
}

nlohmann::json RunLog::summary(const Pipeline& pipeline) const {
  nlohmann::json json = pipeline_summary(pipeline);
  json["stages"] = ipc::latency_json(latency_);
  json["counters"].update({
      {"poses", poses_},
      {"poses_initialising", states_[0]},
      {"poses_tracking", states_[1]},
      {"poses_degraded", states_[2]},
      {"poses_lost", states_[3]},
  });
  json["imu"] = imu_.json();
  json["budget"] = budget_.json(pipeline.budget());
  json["budget"]["superseded"] = pipeline.counters().superseded.load();
  json["threads"] = plan_lines_;
  const MemoryUse memory = memory_use();
  json["memory"] = {{"resident_bytes", memory.resident_bytes},
                    {"peak_resident_bytes", memory.peak_resident_bytes},
                    {"locked_bytes", memory.locked_bytes}};
  if (last_) json["clock_source"] = core::name_of(last_->clock_source);
  json["path_length_m"] = path_length_m_;
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
      "IMU: no scan covered ({} samples decoded) - check imu.preset and that both logs are of the same time",
      pipeline.counters().imu_samples.load());
}

void RunLog::report_end(const Pipeline& pipeline, double seconds) const {
  const OdometryCounters& counters = pipeline.counters();
  spdlog::info("{} scans, {} poses ({} initialising, {} tracking, {} degraded, {} lost) in {:.1f} s",
               counters.scans.load(), poses_, states_[0], states_[1], states_[2], states_[3], seconds);
  const drivers::ScanAssemblerStats scans = pipeline.scan_stats();
  if (scans.lost_packets + scans.partial_scans + pipeline.packets_dropped() > 0) {
    spdlog::info("{} packets lost in the network, {} dropped by niliod, {} partial scans discarded",
                 scans.lost_packets, pipeline.packets_dropped(), scans.partial_scans);
  }
  log_merged_lidars(pipeline);
  const Input& input = pipeline.input();
  if (input.packets && input.packets->stats().malformed > 0) spdlog::warn("{}", input.packets->status());
  if (input.frames) {
    if (input.frames->stats().malformed > 0) spdlog::warn("{}", input.frames->status());
    if (counters.scans_with_imu.load() == 0) report_unused_imu(pipeline);
  }
  if (const std::string text = budget_.text(pipeline.budget()); !text.empty()) spdlog::info("{}", text);
  if (const std::uint64_t missed = counters.decisions_missed.load(); missed > 0)
    spdlog::warn(
        "{} scans do not match the decision log: it belongs to another recording, or to one with other lost "
        "packets; this run does not repeat it",
        missed);
  const MemoryUse memory = memory_use();
  spdlog::info("memory: {} MiB resident, {} MiB peak, {} MiB locked", memory.resident_bytes >> 20U,
               memory.peak_resident_bytes >> 20U, memory.locked_bytes >> 20U);
  spdlog::info("latency by stage:\n{}", ipc::latency_table(latency_));
}

}  // namespace nilio::daemon
