#pragma once

#include "nilio/core/time.hpp"

#include <optional>

namespace nilio::daemon {

/// Estimates the period of a sample stream and predicts the next samples. One thread.
class SamplePeriodEstimator {
 public:
  void add(core::Time stamp);
  /// Time after `time` at which the first sample not before it is due, if `latest` is the last received one;
  /// empty until the period is known.
  [[nodiscard]] std::optional<core::Duration> due_after(core::Time time, core::Time latest) const;

 private:
  std::optional<core::Time> last_;
  core::Duration period_;
};

}  // namespace nilio::daemon
