#pragma once

#include "nilio/core/time.hpp"

#include <optional>

namespace nilio::daemon {

/// The period of samples that come one after the other, and when the next ones are due. One thread.
class SampleRhythm {
 public:
  void add(core::Time stamp);
  /// How long after `time` the first sample that is not before it is due, when `latest` is the last one that
  /// came; nothing while the period is not known.
  [[nodiscard]] std::optional<core::Duration> due_after(core::Time time, core::Time latest) const;

 private:
  std::optional<core::Time> last_;
  core::Duration period_;
};

}  // namespace nilio::daemon
