#include "daemon/output/imu_report.hpp"

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
    spdlog::warn("IMU: not used, because of {}; rotation is predicted at a constant rate",
                 core::name_of(health.reason));
  }
  if (health.trusted && (!last_ || !last_->trusted))
    spdlog::info(was_refused ? "IMU: used again"
                             : "IMU: used from now on: it predicts bends better than a constant rate");
  const double shift_before_ms = last_ ? last_->time_shift_ms : 0.0;
  if (health.time_shift_ms != shift_before_ms)
    spdlog::info("IMU: {:.1f} ms are subtracted from its stamps from now on", health.time_shift_ms);
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

}  // namespace nilio::daemon
