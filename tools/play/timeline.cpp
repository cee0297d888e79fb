#include "tools/play/timeline.hpp"

#include <algorithm>
#include <cmath>

namespace nilio::tools {

namespace {

/// What is smaller comes from the order in which sockets were read, and is no jump.
constexpr core::Duration kNotable{1'000'000'000};

}  // namespace

void PlayTimeline::set_origin(core::Time stamp, std::int64_t due_ns) {
  origin_ = stamp;
  latest_ = stamp;
  origin_due_ns_ = due_ns;
}

PlayTimeline::Due PlayTimeline::next(core::Time stamp, std::int64_t now_ns) {
  Due due;
  if (!begun_) {
    begun_ = true;
    due.event = Event::kBegin;
    set_origin(stamp, std::max(now_ns, last_due_ns_));
  } else {
    due.step = stamp - latest_;
    if (due.step > longest_gap_) {
      due.event = Event::kGapSkipped;
    } else if (due.step < -kNotable) {
      due.event = Event::kBackwards;
    } else if (due.step > kNotable) {
      due.event = Event::kGap;
    }
    if (due.is_new_origin()) set_origin(stamp, std::max(now_ns, last_due_ns_));
  }
  latest_ = std::max(latest_, stamp);
  const double since_origin = static_cast<double>((latest_ - origin_).ns) / speed_;
  last_due_ns_ = origin_due_ns_ + std::llround(since_origin);
  due.due_ns = last_due_ns_;
  return due;
}

}  // namespace nilio::tools
