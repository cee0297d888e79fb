#pragma once

#include "nilio/core/compute_budget.hpp"
#include "nilio/core/imu_health.hpp"
#include "nilio/core/scan.hpp"
#include "nilio/core/tracking.hpp"

#include "ipc/histogram.hpp"
#include "ipc/records.hpp"

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

namespace nilio::daemon {

class Pipeline;

/// JSON of all IMU checks with units and hints.
nlohmann::json imu_health_json(const core::ImuHealth& health);

/// Corrections of each beam that was calibrated: ring, range, elevation, azimuth.
nlohmann::json beam_corrections_json(const std::vector<core::BeamCorrection>& corrections);
/// One line with their root mean squares; empty if no beam was calibrated.
std::string beam_corrections_text(const std::vector<core::BeamCorrection>& corrections);

/// Logs changes of the IMU's state, each once, and summarizes the final state. One thread.
class ImuReport {
 public:
  void update(const core::ImuHealth& health);
  /// Gyro and registration could be compared.
  [[nodiscard]] bool is_compared() const;
  /// Null before the first update.
  [[nodiscard]] nlohmann::json json() const;

 private:
  void report_row(core::ImuCheck check, const core::ImuHealth& health) const;
  void report_use(const core::ImuHealth& health) const;

  std::optional<core::ImuHealth> last_;
};

/// Statistics of deadlines and degradation levels of a run. One thread.
class BudgetReport {
 public:
  void record(const ipc::PoseRecord& record);
  /// {"mode", "budget_ms", "poses", "predicted_by_guard", "recovery_budget", "late_poses", "initialising",
  /// "stops", "degradation_levels", "overshoot_us", "iteration_us"}. Overshoots exclude initialisation, whose
  /// registration has no limit; early poses count as 0.
  [[nodiscard]] nlohmann::json json(const core::BudgetConfig& budget) const;
  /// One-line summary; empty if no pose had a deadline.
  [[nodiscard]] std::string text(const core::BudgetConfig& budget) const;

 private:
  static constexpr std::size_t kStopReasons = static_cast<std::size_t>(core::StopReason::kNonFinite) + 1;

  std::uint64_t poses_ = 0;
  std::uint64_t initialising_ = 0;
  std::uint64_t guarded_ = 0;
  std::uint64_t recoveries_ = 0;
  std::uint64_t late_ = 0;
  std::array<std::uint64_t, kStopReasons> stops_{};
  std::array<std::uint64_t, core::kDegradationLevels> degradation_levels_{};
  ipc::Histogram overshoot_;
  ipc::Histogram iteration_;
};

/// Counters of a run and of its LiDARs for latency.json: {"counters", "lidars"}. Call after Pipeline::join().
nlohmann::json pipeline_summary(const Pipeline& pipeline);
/// Logs the counters of the additional LiDARs. Call after Pipeline::join().
void log_merged_lidars(const Pipeline& pipeline);
/// Error text of a replay without poses, with the counters that explain it.
std::string explain_no_poses(const Pipeline& pipeline);

}  // namespace nilio::daemon
