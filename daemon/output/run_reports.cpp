#include "daemon/output/run_reports.hpp"

#include <algorithm>
#include <array>
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

bool is_alarming(ImuCheckState state) { return state >= ImuCheckState::kWarn; }

}  // namespace

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
  ++degradation_levels_[static_cast<std::size_t>(record.degradation_level) % core::kBudgetRungs];
  if (record.guarded) ++guarded_;
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
  for (std::size_t i = 0; i < core::kBudgetRungs; ++i)
    degradation_levels[core::name_of(static_cast<core::BudgetRung>(i))] = degradation_levels_[i];
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

}  // namespace nilio::daemon
