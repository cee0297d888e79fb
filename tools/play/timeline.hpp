#pragma once

#include "nilio/core/time.hpp"
#include "nilio/drivers/packet.hpp"

#include <cstdint>
#include <optional>

namespace nilio::tools::play {

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

/// Moves the sensor's clock in data packets (1206 bytes) and position packets (512 bytes) to the present: the
/// microseconds past the hour of the first packet become those of the host, and all others move by as much,
/// modulo one hour. Other payloads stay as they are. One thread.
class Restamper {
 public:
  /// `host_now`: UTC, used for the first packet only.
  void apply(drivers::Packet& packet, core::Time host_now);
  /// The next packet is a first one again.
  void begin_again() { offset_us_.reset(); }

 private:
  std::optional<std::uint64_t> offset_us_;
};

}  // namespace nilio::tools::play
