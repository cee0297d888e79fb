#include "tools/play/timeline.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace nilio::tools::play {

namespace {

/// Smaller steps come from the order in which sockets were read.
constexpr core::Duration kNotable{1'000'000'000};

constexpr std::uint64_t kHourUs = 3'600'000'000;
constexpr std::size_t kDataSize = 1206;
constexpr std::size_t kDataTimeOffset = 1200;
constexpr std::size_t kPositionSize = 512;
constexpr std::size_t kPositionTimeOffset = 198;

std::uint64_t load_time(const std::uint8_t* bytes) {
  std::uint64_t value = 0;
  for (std::size_t i = 4; i-- > 0;) value = (value << 8) | bytes[i];
  return value;
}

void store_time(std::uint8_t* bytes, std::uint64_t value) {
  for (std::size_t i = 0; i < 4; ++i) bytes[i] = static_cast<std::uint8_t>(value >> (8 * i));
}

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

void Restamper::apply(drivers::Packet& packet, core::Time host_now) {
  std::uint8_t* time = nullptr;
  if (packet.size == kDataSize) time = packet.data.data() + kDataTimeOffset;
  if (packet.size == kPositionSize) time = packet.data.data() + kPositionTimeOffset;
  if (time == nullptr) return;
  // Sensors count slightly beyond the hour.
  const std::uint64_t sensor_us = load_time(time) % kHourUs;
  if (!offset_us_) {
    const std::uint64_t host_us = static_cast<std::uint64_t>(host_now.ns / 1000) % kHourUs;
    offset_us_ = (host_us + kHourUs - sensor_us) % kHourUs;
  }
  store_time(time, (sensor_us + *offset_us_) % kHourUs);
}

}  // namespace nilio::tools::play
