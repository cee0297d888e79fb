#include "daemon/odometry/sample_period.hpp"

namespace nilio::daemon {

namespace {

using core::Duration;

// Longer steps are gaps.
constexpr Duration kLongestPeriod = Duration::from_milliseconds(100.0);
constexpr std::int64_t kPeriodsAveraged = 16;

}  // namespace

void SamplePeriodEstimator::add(core::Time stamp) {
  const Duration step = last_ ? stamp - *last_ : Duration{};
  last_ = stamp;
  if (step <= Duration{} || step >= kLongestPeriod) return;
  period_ = period_ == Duration{} ? step : period_ + (step - period_) / kPeriodsAveraged;
}

std::optional<Duration> SamplePeriodEstimator::due_after(core::Time time, core::Time latest) const {
  if (period_ <= Duration{}) return std::nullopt;
  if (latest >= time) return Duration{};
  const std::int64_t behind = (time - latest).ns;
  const std::int64_t periods = (behind + period_.ns - 1) / period_.ns;
  return Duration{periods * period_.ns - behind};
}

}  // namespace nilio::daemon
