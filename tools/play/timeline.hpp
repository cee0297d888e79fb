#pragma once

#include "nilio/core/time.hpp"
#include "nilio/drivers/packet.hpp"

#include <cstdint>
#include <optional>

namespace nilio::tools::play {

/// Computes the due time of each stamp of a recording. Due times are relative to one origin, so that errors
/// do not accumulate; a jump of the recording sets a new origin. One thread.
class PlayTimeline {
 public:
  enum class Event {
    kNone,
    kBegin,       ///< first stamp: a new origin, due now
    kGap,         ///< a gap of more than a second, which is kept
    kGapSkipped,  ///< a longer gap than `longest_gap`: a new origin, due now
    kBackwards,   ///< the stamps jump back by more than a second: a new origin, due now
  };
  struct Due {
    std::int64_t due_ns = 0;  ///< CLOCK_MONOTONIC
    Event event = Event::kNone;
    core::Duration step;  ///< from the preceding stamp
    [[nodiscard]] bool is_new_origin() const { return event != Event::kNone && event != Event::kGap; }
  };

  /// `speed` 2 = twice as fast. Gaps beyond `longest_gap` of the recording's time are skipped.
  PlayTimeline(double speed, core::Duration longest_gap) : speed_(speed), longest_gap_(longest_gap) {}

  Due next(core::Time stamp, std::int64_t now_ns);
  /// The next stamp sets a new origin, due no earlier than the last stamp.
  void restart() { begun_ = false; }

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

/// Moves the sensor's clock in data packets (1206 bytes) and position packets (512 bytes) to the present: the
/// first packet's microseconds past the hour become the host's, and all others move by the same amount,
/// modulo one hour. Other payloads are unchanged. One thread.
class Restamper {
 public:
  /// `host_now`: UTC, used for the first packet only.
  void apply(drivers::Packet& packet, core::Time host_now);
  /// The next packet sets a new offset.
  void restart() { offset_us_.reset(); }

 private:
  std::optional<std::uint64_t> offset_us_;
};

}  // namespace nilio::tools::play
