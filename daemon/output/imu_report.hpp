#pragma once

#include "nilio/core/imu_health.hpp"

#include <optional>

#include <nlohmann/json_fwd.hpp>

namespace nilio::daemon {

/// JSON of all IMU checks with units and hints.
nlohmann::json imu_health_json(const core::ImuHealth& health);

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

}  // namespace nilio::daemon
