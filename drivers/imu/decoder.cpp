#include "nilio/drivers/imu/decoder.hpp"

#include "drivers/imu/routes.hpp"
#include "drivers/imu/sample_clock.hpp"
#include "drivers/imu/sample_monitor.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <limits>
#include <optional>
#include <string>
#include <vector>

namespace nilio::drivers {
namespace {

/// Number of slipped groups in a row that changes the grouping; jitter causes single ones.
constexpr int kSlippedGroups = 3;
/// A J1939 sender that is silent for longer may be replaced by another.
constexpr core::Duration kSourceTimeout{1'000'000'000};
/// Later stamps are invalid; sums of them would exceed 64 bits.
constexpr core::Time kLatestStamp{4'000'000'000'000'000'000};

/// The frames of one sample that have arrived so far.
struct ImuGroup {
  /// Bits of the components, and above them of the messages without axes that belong to each sample.
  unsigned members = 0;
  std::array<double, kImuComponents> values{};
  /// Stamp of the first frame with an axis.
  core::Time first_stamp;
  std::optional<std::uint64_t> counter;
  std::optional<std::uint64_t> ticks;
  core::Time ticks_stamp;
  bool saturated = false;
  bool invalid = false;
  bool bad_status = false;

  [[nodiscard]] unsigned components() const { return members & kAllImuComponents; }
};

/// Roll and pitch rates are small with mean 0, so that one of the two may be missing.
bool is_one_level_rate(const ImuMapping& mapping, const std::string& missing) {
  for (const std::size_t axis : {std::size_t{0}, std::size_t{1}}) {
    ImuMapping completed = mapping;
    completed.angular_velocity[axis] = mapping.angular_velocity[2];
    if (missing_axes(completed).empty()) return !missing.empty();
  }
  return false;
}

bool is_same_message(const CanFrame& frame, std::uint32_t id, bool extended, bool j1939) {
  if (extended != frame.extended) return false;
  return j1939 ? j1939_group(id) == j1939_group(frame.id) : id == frame.id;
}

}  // namespace

struct ImuDecoder::Impl {
  Impl(const ImuMapping& mapping, std::vector<ImuRoute> routes);

  std::optional<core::ImuSample> add(const CanFrame& frame);

  /// Sets the axes that no frame carries to 0 instead of NaN.
  void take_as_zero(const std::string& axes);

  std::vector<ImuRoute> routes;
  std::string taken_as_zero;
  ImuDecoderStats stats;
  core::Duration time_offset;
  std::optional<double> temperature;

 private:
  struct SampleStamp {
    core::Time time;
    bool is_from_device = false;
  };
  const ImuRoute* find_route(const CanFrame& frame);
  bool is_from_source(const CanFrame& frame);
  [[nodiscard]] bool contradicts_group(const ImuFrameContent& content, unsigned members) const;
  void close_incomplete();
  void join_group(const ImuFrameContent& content, unsigned members, core::Time stamp);
  bool begins_after_slip(core::Time stamp);
  std::optional<core::ImuSample> complete(core::Time stamp);
  bool follows_counter(const ImuGroup& group);
  SampleStamp stamp_of(const ImuGroup& group, core::Time last_frame);
  bool is_dropped(const ImuGroup& group);

  unsigned wanted_ = 0;
  std::optional<std::uint8_t> source_;
  bool source_is_given_ = false;
  core::Time source_seen_;
  std::uint64_t counter_mask_ = 0;
  std::optional<ImuSampleClock> clock_;
  ImuSampleMonitor monitor_;
  ImuGroup group_;
  std::optional<std::uint64_t> last_counter_;
  std::optional<std::uint64_t> last_ticks_;
  // First and last stamp of the previous complete group's frames with axes.
  core::Time last_start_;
  core::Time last_end_;
  MedianInterval median_interval_;
  bool has_group_ = false;
  core::Time last_stamp_;
  bool has_sample_ = false;
  int slipped_groups_ = 0;
};

ImuDecoder::Impl::Impl(const ImuMapping& mapping, std::vector<ImuRoute> made)
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

void ImuDecoder::Impl::take_as_zero(const std::string& axes) {
  taken_as_zero = axes;
  for (std::size_t i = 0; i < kImuComponents; ++i) {
    if ((wanted_ & (1U << i)) == 0) group_.values[i] = 0.0;
  }
}

const ImuRoute* ImuDecoder::Impl::find_route(const CanFrame& frame) {
  if (frame.error || frame.remote) return nullptr;
  for (const ImuRoute& route : routes) {
    if (is_same_message(frame, route.message.id, route.message.extended, route.message.j1939)) return &route;
  }
  return nullptr;
}

/// Two devices of a kind on one bus differ only in their address: the configured one counts, or the first.
bool ImuDecoder::Impl::is_from_source(const CanFrame& frame) {
  const auto source = static_cast<std::uint8_t>(frame.id);
  const bool silent = !source_is_given_ && frame.stamp - source_seen_ > kSourceTimeout;
  if (!source_ || silent) source_ = source;
  if (*source_ != source) return false;
  source_seen_ = frame.stamp;
  return true;
}

std::optional<core::ImuSample> ImuDecoder::Impl::add(const CanFrame& frame) {
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

/// True when the frame belongs to a later sample than the open group.
bool ImuDecoder::Impl::contradicts_group(const ImuFrameContent& content, unsigned members) const {
  return (group_.members & members) != 0 ||
         (content.counter && group_.counter && *content.counter != *group_.counter);
}

void ImuDecoder::Impl::close_incomplete() {
  // Counters and status alone do not make an incomplete sample.
  if (group_.components() != 0) ++stats.incomplete;
  group_.members = 0;
}

void ImuDecoder::Impl::join_group(const ImuFrameContent& content, unsigned members, core::Time stamp) {
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

/// True when this frame belongs to the previous group, which was closed without it: the frame is dropped and
/// the next one begins the group.
bool ImuDecoder::Impl::begins_after_slip(core::Time stamp) {
  const core::Duration span = last_end_ - last_start_;
  const core::Duration gap = stamp - last_end_;
  const bool slipped = has_group_ && gap.ns >= 0 && span.ns > 2 * gap.ns;
  slipped_groups_ = slipped ? slipped_groups_ + 1 : 0;
  if (slipped_groups_ < kSlippedGroups) return false;
  slipped_groups_ = 0;
  ++stats.incomplete;
  return true;
}

std::optional<core::ImuSample> ImuDecoder::Impl::complete(core::Time last_frame) {
  const ImuGroup group = group_;
  group_.members = 0;
  if (is_dropped(group)) return std::nullopt;
  const auto [stamp, is_from_device] = stamp_of(group, last_frame);
  if ((has_sample_ && stamp <= last_stamp_) || stamp.ns < 0) {
    ++stats.out_of_order;
    return std::nullopt;
  }
  if (has_group_) median_interval_.observe((group.first_stamp - last_start_).ns);
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

/// Also counts the reason. Follows the counter in any case, so that no sample counts as both bad and lost.
bool ImuDecoder::Impl::is_dropped(const ImuGroup& group) {
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

/// False when the counter did not advance.
bool ImuDecoder::Impl::follows_counter(const ImuGroup& group) {
  if (!group.counter) {
    // Without this sample's counter the number of lost samples is unknown.
    last_counter_.reset();
    return true;
  }
  const std::optional<std::uint64_t> last = last_counter_;
  last_counter_ = group.counter;
  if (!last) return true;
  const std::uint64_t step = (*group.counter - *last) & counter_mask_;
  // A larger step is a step back: the device was restarted.
  if (step > 1 && step <= counter_mask_ / 2) stats.lost_samples += step - 1;
  return step != 0;
}

/// The device's time, unless it arrived with the end of the previous sample.
ImuDecoder::Impl::SampleStamp ImuDecoder::Impl::stamp_of(const ImuGroup& group, core::Time last_frame) {
  if (!clock_ || !group.ticks) return {group.first_stamp, false};
  const std::optional<core::Time> stamp = clock_->stamp(*group.ticks, group.ticks_stamp);
  stats.clock_jumps = clock_->jumps();
  const bool is_near = 2 * (last_frame - group.ticks_stamp).ns < median_interval_.ns();
  if (!stamp || !is_near) return {group.first_stamp, false};
  return {*stamp, true};
}

ImuDecoder::ImuDecoder(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
ImuDecoder::ImuDecoder(ImuDecoder&&) noexcept = default;
ImuDecoder& ImuDecoder::operator=(ImuDecoder&&) noexcept = default;
ImuDecoder::~ImuDecoder() = default;

core::Result<ImuDecoder> ImuDecoder::create(const ImuMapping& mapping, const DbcDatabase& database) {
  const std::string missing = missing_axes(mapping);
  if (!missing.empty() && !is_one_level_rate(mapping, missing)) {
    return core::Error{"IMU '" + mapping.name + "' has no " + missing +
                       "; the motion during a scan needs all six axes but for one of angular velocity x and "
                       "y: use another IMU, or none"};
  }
  core::Result<ImuDecoder> decoder = create_partial(mapping, database);
  if (decoder && !missing.empty()) decoder->impl_->take_as_zero(missing);
  return decoder;
}

core::Result<ImuDecoder> ImuDecoder::create_partial(const ImuMapping& mapping, const DbcDatabase& database) {
  core::Result<std::vector<ImuRoute>> routes = make_imu_routes(mapping, database);
  if (!routes) return routes.error();
  const bool has_axis =
      std::any_of(routes->begin(), routes->end(), [](const ImuRoute& route) { return !route.axes.empty(); });
  if (!has_axis) return core::Error{"IMU '" + mapping.name + "' has no axis at all: map at least one"};
  return ImuDecoder(std::make_unique<Impl>(mapping, std::move(routes).value()));
}

std::optional<core::ImuSample> ImuDecoder::add(const CanFrame& frame) {
  std::optional<core::ImuSample> sample = impl_->add(frame);
  if (sample) sample->stamp = sample->stamp - impl_->time_offset;
  return sample;
}

const std::string& ImuDecoder::taken_as_zero() const { return impl_->taken_as_zero; }

const ImuDecoderStats& ImuDecoder::stats() const { return impl_->stats; }

bool ImuFrameFilter::takes(const CanFrame& frame) const {
  if (frame.error || frame.remote) return false;
  return std::any_of(identifiers_.begin(), identifiers_.end(), [&frame](const Identifier& own) {
    return is_same_message(frame, own.id, own.extended, own.j1939);
  });
}

std::string ImuFrameFilter::text() const {
  std::string text;
  for (const Identifier& own : identifiers_) {
    std::array<char, 16> number{};
    std::snprintf(number.data(), number.size(), "0x%X", static_cast<unsigned>(own.id));
    text += (text.empty() ? "" : ", ") + std::string(number.data());
  }
  return text;
}

ImuFrameFilter ImuDecoder::frame_filter() const {
  std::vector<ImuFrameFilter::Identifier> identifiers;
  for (const ImuRoute& route : impl_->routes)
    identifiers.push_back({route.message.id, route.message.extended, route.message.j1939});
  return ImuFrameFilter(std::move(identifiers));
}

std::optional<double> ImuDecoder::temperature_degc() const { return impl_->temperature; }

}  // namespace nilio::drivers
