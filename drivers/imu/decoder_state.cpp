#include "drivers/imu/decoder_state.hpp"

#include <algorithm>
#include <limits>

namespace nilio::drivers {
namespace {

/// Groups in a row that look slipped before the grouping is changed; jitter makes single ones.
constexpr int kSlippedGroups = 3;
/// A J1939 sender that was silent so long may be replaced by another.
constexpr core::Duration kSourceTimeout{1'000'000'000};
/// Stamps outside are no time, and sums of them would leave 64 bits.
constexpr core::Time kLatestStamp{4'000'000'000'000'000'000};

}  // namespace

ImuDecoder::State::State(const ImuMapping& mapping, std::vector<ImuRoute> made)
    : routes(std::move(made)),
      time_offset(mapping.time_offset),
      source_(mapping.source_address),
      source_is_given_(mapping.source_address.has_value()) {
  group_.values.fill(std::numeric_limits<double>::quiet_NaN());
  for (const ImuRoute& route : routes) {
    for (const ImuRoute::Axis& axis : route.axes) wanted_ |= 1U << axis.component;
    if (route.counter) {
      counter_mask_ = ~std::uint64_t{0} >> (64U - route.message.signals[*route.counter].length);
    }
    if (!route.ticks) continue;
    const std::uint16_t bits = route.message.signals[*route.ticks].length;
    const std::uint64_t wrap = bits < 64 ? std::uint64_t{1} << bits : 0;
    clock_.emplace(mapping.sample_time->tick_ns,
                   mapping.sample_time->wrap != 0 ? mapping.sample_time->wrap : wrap);
  }
}

void ImuDecoder::State::take_as_zero(const std::string& axes) {
  taken_as_zero = axes;
  for (std::size_t i = 0; i < kImuComponents; ++i) {
    if ((wanted_ & (1U << i)) == 0) group_.values[i] = 0.0;
  }
}

const ImuRoute* ImuDecoder::State::find_route(const CanFrame& frame) {
  if (frame.error || frame.remote) return nullptr;
  for (const ImuRoute& route : routes) {
    if (route.message.extended != frame.extended) continue;
    const bool matches = route.message.j1939 ? j1939_group(route.message.id) == j1939_group(frame.id)
                                             : route.message.id == frame.id;
    if (matches) return &route;
  }
  return nullptr;
}

/// Two devices of a kind on one bus differ in their address only: the first is taken, or the one wanted.
bool ImuDecoder::State::is_from_source(const CanFrame& frame) {
  const auto source = static_cast<std::uint8_t>(frame.id);
  const bool silent = !source_is_given_ && frame.stamp - source_seen_ > kSourceTimeout;
  if (!source_ || silent) source_ = source;
  if (*source_ != source) return false;
  source_seen_ = frame.stamp;
  return true;
}

std::optional<core::ImuSample> ImuDecoder::State::add(const CanFrame& frame) {
  const ImuRoute* route = find_route(frame);
  if (route == nullptr) {
    ++stats.other_frames;
    return std::nullopt;
  }
  if (frame.stamp.ns < 0 || frame.stamp > kLatestStamp) {
    ++stats.out_of_order;
    return std::nullopt;
  }
  if (route->message.j1939 && !is_from_source(frame)) {
    ++stats.other_sources;
    return std::nullopt;
  }
  ++stats.frames;
  const std::optional<ImuFrameContent> content = route->read(frame);
  if (!content) {
    ++stats.short_frames;
    return std::nullopt;
  }
  if (content->temperature) temperature = content->temperature;
  const unsigned members = content->present | route->member;
  if (members == 0) return std::nullopt;
  if (contradicts_group(*content, members)) close_incomplete();
  const bool is_first = group_.components() == 0 && content->present != 0;
  if (is_first && begins_after_slip(frame.stamp)) return std::nullopt;
  join_group(*content, members, frame.stamp);
  return group_.components() == wanted_ ? complete(frame.stamp) : std::nullopt;
}

/// True when the frame belongs to a later sample than the group.
bool ImuDecoder::State::contradicts_group(const ImuFrameContent& content, unsigned members) const {
  return (group_.members & members) != 0 ||
         (content.counter && group_.counter && *content.counter != *group_.counter);
}

void ImuDecoder::State::close_incomplete() {
  // Counters and status alone are no sample that could be incomplete.
  if (group_.components() != 0) ++stats.incomplete;
  group_.members = 0;
}

void ImuDecoder::State::join_group(const ImuFrameContent& content, unsigned members, core::Time stamp) {
  if (group_.members == 0) {
    const std::array<double, kImuComponents> values = group_.values;
    group_ = ImuGroup{};
    group_.values = values;
  }
  if (group_.components() == 0) group_.first_stamp = stamp;
  group_.members |= members;
  for (std::size_t i = 0; i < kImuComponents; ++i) {
    if ((content.present >> i & 1U) != 0) group_.values[i] = content.values[i];
  }
  if (content.counter) group_.counter = content.counter;
  if (content.ticks) {
    group_.ticks = content.ticks;
    group_.ticks_stamp = stamp;
  }
  group_.saturated = group_.saturated || content.saturated;
  group_.invalid = group_.invalid || content.invalid;
  group_.bad_status = group_.bad_status || content.bad_status;
}

/// True when this frame belongs to the group before, which was closed without it: it is dropped, and the next
/// one begins the group.
bool ImuDecoder::State::begins_after_slip(core::Time stamp) {
  const core::Duration span = last_end_ - last_start_;
  const core::Duration gap = stamp - last_end_;
  const bool slipped = has_group_ && gap.ns >= 0 && span.ns > 2 * gap.ns;
  slipped_groups_ = slipped ? slipped_groups_ + 1 : 0;
  if (slipped_groups_ < kSlippedGroups) return false;
  slipped_groups_ = 0;
  ++stats.incomplete;
  return true;
}

std::optional<core::ImuSample> ImuDecoder::State::complete(core::Time last_frame) {
  const ImuGroup group = group_;
  group_.members = 0;
  if (is_dropped(group)) return std::nullopt;
  const auto [stamp, is_from_device] = stamp_of(group, last_frame);
  if ((has_sample_ && stamp <= last_stamp_) || stamp.ns < 0) {
    ++stats.out_of_order;
    return std::nullopt;
  }
  if (has_group_) usual_interval_.observe((group.first_stamp - last_start_).ns);
  has_group_ = has_sample_ = true;
  last_start_ = group.first_stamp;
  last_end_ = last_frame;
  last_stamp_ = stamp;
  ++stats.samples;
  if (is_from_device) ++stats.device_stamped;
  if (group.saturated) ++stats.saturated;
  core::ImuSample sample;
  sample.stamp = stamp;
  std::copy_n(group.values.begin(), 3, sample.angular_velocity.begin());
  std::copy_n(group.values.begin() + 3, 3, sample.linear_acceleration.begin());
  monitor_.observe(sample, stats);
  return sample;
}

/// Counts why, too. The counter is followed in any case, so that no sample is counted as bad and lost.
bool ImuDecoder::State::is_dropped(const ImuGroup& group) {
  const bool same_ticks = group.ticks && group.ticks == last_ticks_;
  if (group.ticks) last_ticks_ = group.ticks;
  if (!follows_counter(group) || (same_ticks && !group.counter)) {
    ++stats.repeated;
    return true;
  }
  if (group.bad_status) {
    ++stats.bad_status;
    return true;
  }
  if (group.invalid) ++stats.invalid;
  return group.invalid;
}

/// False when the counter stands.
bool ImuDecoder::State::follows_counter(const ImuGroup& group) {
  if (!group.counter) {
    // Some samples' counters may be lost: then what is missing cannot be told.
    last_counter_.reset();
    return true;
  }
  const std::optional<std::uint64_t> last = last_counter_;
  last_counter_ = group.counter;
  if (!last) return true;
  const std::uint64_t step = (*group.counter - *last) & counter_mask_;
  // Half the range ahead is as well half behind: a device that began again.
  if (step > 1 && step <= counter_mask_ / 2) stats.lost_samples += step - 1;
  return step != 0;
}

/// The device's time, when it came with this sample and not at the end of the one before.
ImuDecoder::State::SampleStamp ImuDecoder::State::stamp_of(const ImuGroup& group, core::Time last_frame) {
  if (!clock_ || !group.ticks) return {group.first_stamp, false};
  const std::optional<core::Time> stamp = clock_->stamp(*group.ticks, group.ticks_stamp);
  stats.clock_jumps = clock_->jumps();
  const bool is_near = 2 * (last_frame - group.ticks_stamp).ns < usual_interval_.ns();
  if (!stamp || !is_near) return {group.first_stamp, false};
  return {*stamp, true};
}

}  // namespace nilio::drivers
