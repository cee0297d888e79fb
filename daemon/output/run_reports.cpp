#include "daemon/output/run_reports.hpp"

#include "nilio/core/units.hpp"

#include "daemon/odometry/pipeline.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

#include <nlohmann/json.hpp>
#include <spdlog/spdlog.h>

namespace nilio::daemon {

namespace {

using core::ImuCheck;
using core::ImuCheckState;
using core::ImuDiagnosis;
using core::ImuHealth;

ImuCheck check_at(std::size_t index) { return static_cast<ImuCheck>(index); }

/// A beam that was not seen has no correction.
bool is_calibrated(const core::BeamCorrection& beam) {
  return beam.range_m != 0.0 || beam.elevation_rad != 0.0 || beam.azimuth_rad != 0.0;
}

bool is_alarming(ImuCheckState state) { return state >= ImuCheckState::kWarn; }

/// Counters of one LiDAR and its final stream state.
nlohmann::json lidar_summary(const LidarInput& lidar) {
  const drivers::ScanAssemblerStats stats = lidar.channel.stats();
  nlohmann::json json = {
      {"section", lidar.channel.section()},
      {"packets", stats.packets},
      {"packets_lost", stats.lost_packets},
      {"packets_duplicate", stats.duplicate_packets},
      {"packets_late", stats.late_packets},
      {"packets_bad_length", stats.bad_length},
      {"packets_position", stats.position_packets},
      {"packets_dropped_kernel", lidar.source.stats().kernel_dropped},
      {"packets_dropped_ring", lidar.ring.dropped()},
      {"foreign_packets", lidar.channel.foreign_packets()},
      {"points", stats.points},
      {"points_out_of_range", stats.points_out_of_range},
  };
  const drivers::ScanAssembler* assembler = lidar.channel.assembler();
  if (assembler == nullptr) return json;
  const drivers::ScanAssemblerStatus status = assembler->status();
  json["model"] = assembler->sensor().name;
  json["return_mode"] = drivers::return_mode_name(status.mode);
  json["revolutions_per_minute"] = status.revolutions_per_minute;
  json["packet_period_us"] = status.packet_period_us;
  json["field_of_view_deg"] = 360.0 - status.blind_sector_deg;
  json["clock_source"] = core::name_of(status.clock_source);
  json["clock_offset_s"] = status.clock_offset_s;
  json["clock_drift_ppm"] = status.clock_drift_ppm;
  return json;
}

nlohmann::json merge_summary(const MergeCounters& counters) {
  return {{"points_merged", counters.points_merged},
          {"points_unused", counters.points_unused},
          {"scans_without", counters.scans_without},
          {"waits_timed_out", counters.waits_timed_out}};
}

nlohmann::json decoder_summary(const drivers::ImuDecoderStats& imu) {
  return {{"imu_frames", imu.frames},
          {"imu_frames_other", imu.other_frames},
          {"imu_frames_other_source", imu.other_sources},
          {"imu_frames_short", imu.short_frames},
          {"imu_samples_incomplete", imu.incomplete},
          {"imu_samples_out_of_order", imu.out_of_order},
          {"imu_samples_lost", imu.lost_samples},
          {"imu_samples_bad_status", imu.bad_status},
          {"imu_samples_invalid", imu.invalid},
          {"imu_samples_repeated", imu.repeated},
          {"imu_samples_frozen", imu.frozen},
          {"imu_samples_saturated", imu.saturated},
          {"imu_samples_device_stamped", imu.device_stamped},
          {"imu_gaps", imu.gaps},
          {"imu_longest_gap_us", imu.longest_gap.ns / 1000},
          {"imu_clock_jumps", imu.clock_jumps}};
}

}  // namespace

nlohmann::json beam_corrections_json(const std::vector<core::BeamCorrection>& corrections) {
  nlohmann::json beams = nlohmann::json::array();
  for (std::size_t ring = 0; ring < corrections.size(); ++ring) {
    const core::BeamCorrection& beam = corrections[ring];
    if (!is_calibrated(beam)) continue;
    beams.push_back({{"ring", ring},
                     {"range_m", beam.range_m},
                     {"elevation_deg", beam.elevation_rad / kRadiansPerDegree},
                     {"azimuth_deg", beam.azimuth_rad / kRadiansPerDegree}});
  }
  return beams;
}

std::string beam_corrections_text(const std::vector<core::BeamCorrection>& corrections) {
  double count = 0.0;
  double range_square = 0.0;
  double elevation_square = 0.0;
  double azimuth_square = 0.0;
  for (const core::BeamCorrection& beam : corrections) {
    if (!is_calibrated(beam)) continue;
    count += 1.0;
    range_square += beam.range_m * beam.range_m;
    elevation_square += beam.elevation_rad * beam.elevation_rad;
    azimuth_square += beam.azimuth_rad * beam.azimuth_rad;
  }
  if (count == 0.0) return {};
  return fmt::format(
      "LiDAR: {} beams corrected by {:.0f} mm in range, {:.2f} deg in elevation and {:.2f} deg in "
      "azimuth (root mean square)",
      count, 1e3 * std::sqrt(range_square / count), std::sqrt(elevation_square / count) / kRadiansPerDegree,
      std::sqrt(azimuth_square / count) / kRadiansPerDegree);
}

void ImuReport::report_row(ImuCheck check, const ImuHealth& health) const {
  const ImuDiagnosis& row = health[check];
  const ImuCheckState before = last_ ? (*last_)[check].state : ImuCheckState::kUnknown;
  if (row.state == before) return;
  if (is_alarming(row.state)) {
    spdlog::warn("IMU: {} is {}: {:.3g} {} (threshold {:.3g}): {}", core::name_of(check),
                 core::name_of(row.state), row.value, core::unit_of(check), row.threshold,
                 core::hint_for(check, health));
  } else if (row.state == ImuCheckState::kOk && is_alarming(before)) {
    spdlog::info("IMU: {} is ok again: {:.3g} {}", core::name_of(check), row.value, core::unit_of(check));
  }
}

void ImuReport::report_use(const ImuHealth& health) const {
  const bool refused = !health.trusted && health.reason != ImuCheck::kCount;
  const bool was_refused = last_ && !last_->trusted && last_->reason != ImuCheck::kCount;
  if (refused && (!was_refused || last_->reason != health.reason)) {
    spdlog::warn("IMU: rejected because of {}; rotation is predicted at a constant rate",
                 core::name_of(health.reason));
  }
  if (health.trusted && (!last_ || !last_->trusted))
    spdlog::info(was_refused ? "IMU: in use again"
                             : "IMU: in use; it predicts turns better than a constant rate");
  const double shift_before_ms = last_ ? last_->time_shift_ms : 0.0;
  if (health.time_shift_ms != shift_before_ms)
    spdlog::info("IMU: time shift {:.1f} ms is subtracted from its stamps", health.time_shift_ms);
}

void ImuReport::update(const ImuHealth& health) {
  for (std::size_t i = 0; i < core::kImuChecks; ++i) report_row(check_at(i), health);
  report_use(health);
  last_ = health;
}

bool ImuReport::is_compared() const {
  return last_ && ((*last_)[ImuCheck::kGyroAgreement].worst_state != ImuCheckState::kUnknown ||
                   (*last_)[ImuCheck::kGyroBias].worst_state != ImuCheckState::kUnknown);
}

nlohmann::json imu_health_json(const ImuHealth& health) {
  nlohmann::json json;
  json["trusted"] = health.trusted;
  json["reason"] = core::name_of(health.reason);
  json["demotions"] = health.demotions;
  json["time_offset_sigma_ms"] = health.time_offset_sigma_ms;
  json["time_shift_ms"] = health.time_shift_ms;
  for (std::size_t i = 0; i < core::kImuChecks; ++i) {
    const ImuCheck check = check_at(i);
    const ImuDiagnosis& row = health[check];
    json["checks"][core::name_of(check)] = {{"value", row.value},
                                            {"unit", core::unit_of(check)},
                                            {"threshold", row.threshold},
                                            {"state", core::name_of(row.state)},
                                            {"worst_state", core::name_of(row.worst_state)},
                                            {"worst_value", row.worst_value},
                                            {"hint", core::hint_for(check, health)}};
  }
  return json;
}

nlohmann::json ImuReport::json() const { return last_ ? imu_health_json(*last_) : nlohmann::json(nullptr); }

void BudgetReport::record(const ipc::PoseRecord& record) {
  if (!record.has_deadline) return;
  ++poses_;
  ++stops_[static_cast<std::size_t>(record.stop_reason) % kStopReasons];
  ++degradation_levels_[static_cast<std::size_t>(record.degradation_level) % core::kDegradationLevels];
  if (record.guarded) ++guarded_;
  if (record.recovery_budget) ++recoveries_;
  if (record.state == ipc::TrackingState::kInitialising) {
    ++initialising_;
    return;
  }
  if (record.overshoot_ns > 0) ++late_;
  overshoot_.record(record.overshoot_ns);
  iteration_.record(record.iteration_ns);
}

nlohmann::json BudgetReport::json(const core::BudgetConfig& budget) const {
  nlohmann::json stops = nlohmann::json::object();
  for (std::size_t i = 0; i < kStopReasons; ++i)
    stops[core::name_of(static_cast<core::StopReason>(i))] = stops_[i];
  nlohmann::json degradation_levels = nlohmann::json::object();
  for (std::size_t i = 0; i < core::kDegradationLevels; ++i)
    degradation_levels[core::name_of(static_cast<core::DegradationLevel>(i))] = degradation_levels_[i];
  const auto row = [](const ipc::Histogram& histogram) {
    const ipc::LatencySummary s = ipc::summarize("", histogram);
    return nlohmann::json{{"count", s.count}, {"p50", s.p50_us},     {"p90", s.p90_us},
                          {"p99", s.p99_us},  {"p99_9", s.p99_9_us}, {"max", s.max_us}};
  };
  return {{"mode", core::name_of(budget.mode)},
          {"budget_ms", static_cast<double>(budget.budget.ns) * 1e-6},
          {"poses", poses_},
          {"initialising", initialising_},
          {"predicted_by_guard", guarded_},
          {"recovery_budget", recoveries_},
          {"late_poses", late_},
          {"stops", stops},
          {"degradation_levels", degradation_levels},
          {"overshoot_us", row(overshoot_)},
          {"iteration_us", row(iteration_)}};
}

std::string BudgetReport::text(const core::BudgetConfig& budget) const {
  if (poses_ == 0) return "";
  const auto percent = [&](std::uint64_t count) {
    return 100.0 * static_cast<double>(count) / static_cast<double>(poses_);
  };
  const ipc::LatencySummary overshoot = ipc::summarize("", overshoot_);
  std::array<char, 320> line{};
  std::snprintf(line.data(), line.size(),
                "budget %s, %.1f ms: poses with full registration %.1f %%, fewer points %.1f %%, "
                "NDT or ICP only %.1f %%, prediction %.1f %%; %llu late poses, maximum %.0f us (p99 "
                "%.0f us); %llu published by the guard",
                core::name_of(budget.mode), static_cast<double>(budget.budget.ns) * 1e-6,
                percent(degradation_levels_[0]), percent(degradation_levels_[1]),
                percent(degradation_levels_[2] + degradation_levels_[3]), percent(degradation_levels_[4]),
                static_cast<unsigned long long>(late_), overshoot.max_us, overshoot.p99_us,
                static_cast<unsigned long long>(guarded_));
  return line.data();
}

nlohmann::json pipeline_summary(const Pipeline& pipeline) {
  const drivers::ScanAssemblerStats scans = pipeline.scan_stats();
  const OdometryCounters& counters = pipeline.counters();
  nlohmann::json json;
  json["counters"] = {
      {"packets", scans.packets},
      {"packets_lost", scans.lost_packets},
      {"packets_duplicate", scans.duplicate_packets},
      {"packets_late", scans.late_packets},
      {"packets_bad_length", scans.bad_length},
      {"packets_dropped_ring", pipeline.packets_dropped()},
      {"foreign_packets", pipeline.foreign_packets()},
      {"packets_damaged_stamp", scans.damaged_stamps},
      {"time_jumps", scans.time_jumps},
      {"host_clock_jumps", scans.host_clock_jumps},
      {"return_mode_changes", scans.mode_changes},
      {"firings", scans.firings},
      {"firings_in_scans", scans.firings_in_scans},
      {"firings_discarded", scans.firings_discarded},
      {"firings_bad", scans.firings_bad},
      {"firings_late", scans.firings_late},
      {"scans", scans.scans},
      {"scans_partial", scans.partial_scans},
      {"scans_superseded", counters.superseded.load()},
      {"points", scans.points},
      {"imu_samples", counters.imu_samples.load()},
      {"imu_samples_refused", counters.imu_refused.load()},
      {"imu_samples_dropped_ring", pipeline.samples_dropped()},
      {"imu_timeouts", counters.imu_timeouts.load()},
      {"scans_with_imu", counters.scans_with_imu.load()},
      {"log_events_dropped", pipeline.event_log().dropped()},
  };
  json["counters"].update(decoder_summary(pipeline.imu_stats()));
  json["lidars"] = nlohmann::json::array();
  for (std::size_t i = 0; i < pipeline.lidars().size(); ++i) {
    json["lidars"].push_back(lidar_summary(*pipeline.lidars()[i]));
    if (i > 0) json["lidars"].back().update(merge_summary(pipeline.merge_counters(i)));
  }
  return json;
}

void log_merged_lidars(const Pipeline& pipeline) {
  for (std::size_t i = 1; i < pipeline.lidars().size(); ++i) {
    const LidarInput& lidar = *pipeline.lidars()[i];
    const MergeCounters& merged = pipeline.merge_counters(i);
    const drivers::ScanAssemblerStats stats = lidar.channel.stats();
    spdlog::info(
        "{}: {} packets, {} lost in the network, {} dropped by niliod; {} points merged, {} unused; {} scans "
        "without "
        "it, {} "
        "processed before its packets arrived",
        lidar.channel.section(), stats.packets, stats.lost_packets, lidar.ring.dropped(),
        merged.points_merged, merged.points_unused, merged.scans_without, merged.waits_timed_out);
    if (lidar.source.stats().malformed > 0)
      spdlog::warn("{}: {}", lidar.channel.section(), lidar.source.status());
  }
}

std::string explain_no_poses(const Pipeline& pipeline) {
  const drivers::ScanAssemblerStats stats = pipeline.scan_stats();
  std::string text = "no scan was completed: " + std::to_string(stats.packets) + " packets, " +
                     std::to_string(stats.bad_length) + " of another length, " +
                     std::to_string(stats.partial_scans) +
                     " scans covered less than lidar.min_coverage of the field of view";
  if (pipeline.input().packets) text += "; " + pipeline.input().packets->status();
  return text;
}

}  // namespace nilio::daemon
