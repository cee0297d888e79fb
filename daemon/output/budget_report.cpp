#include "daemon/output/budget_report.hpp"

#include <algorithm>
#include <array>
#include <cstdio>

#include <nlohmann/json.hpp>

namespace nilio::daemon {

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
  std::snprintf(
      line.data(), line.size(),
      "budget %s, %.1f ms: %.1f %% of the poses from whole registrations, %.1f %% from fewer points, "
      "%.1f %% from part of the steps, %.1f %% predictions; %llu late poses, by at most %.0f us (p99 "
      "%.0f us); %llu handed over by the guard",
      core::name_of(budget.mode), static_cast<double>(budget.budget.ns) * 1e-6,
      percent(degradation_levels_[0]), percent(degradation_levels_[1]),
      percent(degradation_levels_[2] + degradation_levels_[3]), percent(degradation_levels_[4]),
      static_cast<unsigned long long>(late_), overshoot.max_us, overshoot.p99_us,
      static_cast<unsigned long long>(guarded_));
  return line.data();
}

}  // namespace nilio::daemon
