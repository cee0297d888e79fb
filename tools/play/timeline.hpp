#pragma once

#include "nilio/core/time.hpp"

#include <cstdint>

namespace nilio::tools {

/// Says when each stamp of a recording is due. Due times are reckoned from one origin, so that no error adds
/// up; where the recording jumps there is a new origin. One thread.
class PlayTimeline {
 public:
  enum class Event {
    kNone,
    kBegin,       ///< first stamp: a new origin, due now
    kGap,         ///< the recording has a gap of more than a second, which is waited for
    kGapSkipped,  ///< the gap is longer than wanted: a new origin, due at once
    kBackwards,   ///< the stamps jump back by more than a second: a new origin, due at once
  };
  struct Due {
    std::int64_t due_ns = 0;  ///< CLOCK_MONOTONIC
    Event event = Event::kNone;
    core::Duration step;  ///< from the stamp before
    [[nodiscard]] bool is_new_origin() const { return event != Event::kNone && event != Event::kGap; }
  };

  /// `speed` 2 = twice as fast. Gaps beyond `longest_gap` of the recording's time are skipped.
  PlayTimeline(double speed, core::Duration longest_gap) : speed_(speed), longest_gap_(longest_gap) {}

  Due next(core::Time stamp, std::int64_t now_ns);
  /// The next stamp is a first one again; it is due no earlier than what went before.
  void begin_again() { begun_ = false; }

 private:
  void set_origin(core::Time stamp, std::int64_t due_ns);

  double speed_;
  core::Duration longest_gap_;
  bool begun_ = false;
  core::Time origin_;
  std::int64_t origin_due_ns_ = 0;
  core::Time latest_;
  std::int64_t last_due_ns_ = 0;
};

}  // namespace nilio::tools
