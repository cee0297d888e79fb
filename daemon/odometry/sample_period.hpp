#pragma once

#include "nilio/core/time.hpp"

#include <cstdint>
#include <optional>

namespace nilio::daemon {

/// Estimates the period of a sample stream and predicts the next samples. One thread.
class SamplePeriodEstimator {
 public:
  /// Adds the stamp of the next sample. Gaps and stamps that go back do not change the period.
  void add(core::Time stamp) {
    const core::Duration step = last_ ? stamp - *last_ : core::Duration{};
    last_ = stamp;
    if (step <= core::Duration{} || step >= kMaxPeriod) return;
    period_ = period_ == core::Duration{} ? step : period_ + (step - period_) / kAveragedPeriods;
  }

  /// Time after `time` at which the first sample not before it is due, if `latest` is the last received one;
  /// empty until the period is known.
  [[nodiscard]] std::optional<core::Duration> due_after(core::Time time, core::Time latest) const {
    if (period_ <= core::Duration{}) return std::nullopt;
    if (latest >= time) return core::Duration{};
    const std::int64_t behind = (time - latest).ns;
    const std::int64_t periods = (behind + period_.ns - 1) / period_.ns;
    return core::Duration{periods * period_.ns - behind};
  }

 private:
  /// Longer steps are gaps.
  static constexpr core::Duration kMaxPeriod = core::Duration::from_milliseconds(100.0);
  static constexpr std::int64_t kAveragedPeriods = 16;

  std::optional<core::Time> last_;
  core::Duration period_;
};

}  // namespace nilio::daemon
