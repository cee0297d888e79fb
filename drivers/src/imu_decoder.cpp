#include "nilio/drivers/imu_decoder.hpp"

#include "nilio/drivers/nearest_name.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace nilio::drivers {
namespace {

using core::Error;

constexpr std::size_t kComponents = 6;
constexpr unsigned kAllPresent = (1U << kComponents) - 1U;
/// Groups in a row that look slipped before the grouping is changed; jitter makes single ones.
constexpr int kSlippedGroups = 3;

const ImuAxis& axis_of(const ImuMapping& mapping, std::size_t component) {
  return component < 3 ? mapping.angular_velocity[component] : mapping.linear_acceleration[component - 3];
}

std::string describe_can_id(std::uint32_t id) {
  std::array<char, 16> text{};
  std::snprintf(text.data(), text.size(), "0x%X", static_cast<unsigned>(id));
  return text.data();
}

std::string component_name(std::size_t component) {
  const std::string axis(1, "xyz"[component % 3]);
  return (component < 3 ? "angular velocity " : "linear acceleration ") + axis;
}

Error message_missing(const ImuAxis& axis, const std::string& use, const DbcDatabase& database) {
  std::vector<std::string> names;
  for (const DbcMessage& message : database.messages) names.push_back(message.name);
  return {database.path + ": no message '" + axis.message + "' for " + use +
          nearest_name_hint(axis.message, names)};
}

Error signal_missing(const ImuAxis& axis, const std::string& use, const DbcDatabase& database,
                     const DbcMessage& message) {
  std::vector<std::string> names;
  for (const DbcSignal& signal : message.signals) names.push_back(signal.name);
  return {database.path + ": message '" + axis.message + "' has no signal '" + axis.signal + "' for " + use +
          nearest_name_hint(axis.signal, names)};
}

/// What is wrong with an axis whose signal exists, or nothing.
std::optional<Error> check_axis(const ImuAxis& axis, const std::string& use, const DbcDatabase& database,
                                const DbcMessage& message, const DbcSignal& signal) {
  const std::string where =
      database.path + ": signal '" + axis.signal + "' of message '" + axis.message + "' for " + use;
  if (signal.multiplexed)
    return Error{where + " is multiplexed; an IMU signal must be in every frame of its message"};
  if (required_length(signal) > message.length) {
    return Error{where + " does not fit into the message's " + std::to_string(message.length) +
                 " bytes; correct the file"};
  }
  if (!std::isfinite(axis.scale) || axis.scale == 0.0) {
    return Error{where + " has the scale " + std::to_string(axis.scale) +
                 "; give the factor from its unit to SI"};
  }
  return std::nullopt;
}

}  // namespace

core::Result<ImuDecoder> ImuDecoder::create(const ImuMapping& mapping, const DbcDatabase& database) {
  ImuDecoder decoder;
  for (std::size_t component = 0; component < kComponents; ++component) {
    const ImuAxis& axis = axis_of(mapping, component);
    const std::string use = component_name(component) + " of IMU '" + mapping.name + "'";
    const DbcMessage* message = database.find(axis.message);
    if (message == nullptr) return message_missing(axis, use, database);
    const DbcSignal* signal = database.find(axis.message, axis.signal);
    if (signal == nullptr) return signal_missing(axis, use, database, *message);
    if (auto problem = check_axis(axis, use, database, *message, *signal)) return *problem;
    auto route = std::find_if(decoder.routes_.begin(), decoder.routes_.end(), [&](const Route& r) {
      return r.id == message->id && r.extended == message->extended;
    });
    if (route == decoder.routes_.end()) {
      decoder.routes_.push_back({.id = message->id, .extended = message->extended, .axes = {}, .mask = 0});
      route = std::prev(decoder.routes_.end());
    }
    route->axes.push_back({*signal, axis.scale, component});
    route->mask |= 1U << component;
  }
  return decoder;
}

const ImuDecoder::Route* ImuDecoder::route_of(const CanFrame& frame) const {
  if (frame.error || frame.remote) return nullptr;
  for (const Route& route : routes_) {
    if (route.id == frame.id && route.extended == frame.extended) return &route;
  }
  return nullptr;
}

std::string ImuDecoder::identifiers() const {
  std::string text;
  for (const Route& route : routes_) text += (text.empty() ? "" : ", ") + describe_can_id(route.id);
  return text;
}

std::optional<core::ImuSample> ImuDecoder::add(const CanFrame& frame) {
  const Route* route = route_of(frame);
  if (route == nullptr) {
    ++stats_.other_frames;
    return std::nullopt;
  }
  ++stats_.frames;
  const std::size_t length = std::min<std::size_t>(frame.length, frame.data.size());
  std::array<double, kComponents> values = values_;
  for (const Axis& axis : route->axes) {
    const std::optional<double> physical = decode_physical(axis.signal, {frame.data.data(), length});
    if (!physical || !std::isfinite(*physical)) {
      ++stats_.short_frames;
      return std::nullopt;
    }
    values[axis.component] = *physical * axis.scale;
  }
  if ((present_ & route->mask) != 0) {
    ++stats_.incomplete;
    present_ = 0;
  }
  if (present_ == 0) {
    if (begins_after_slip(frame)) return std::nullopt;
    group_start_ = frame.stamp;
  }
  values_ = values;
  present_ |= route->mask;
  return present_ == kAllPresent ? complete(frame.stamp) : std::nullopt;
}

/// True when this frame belongs to the group before, which was closed without it: it is dropped, and the next
/// one begins the group.
bool ImuDecoder::begins_after_slip(const CanFrame& frame) {
  const core::Duration span = last_end_ - last_start_;
  const core::Duration gap = frame.stamp - last_end_;
  const bool slipped = has_sample_ && gap.ns >= 0 && span.ns > 2 * gap.ns;
  slipped_groups_ = slipped ? slipped_groups_ + 1 : 0;
  if (slipped_groups_ < kSlippedGroups) return false;
  slipped_groups_ = 0;
  ++stats_.incomplete;
  return true;
}

std::optional<core::ImuSample> ImuDecoder::complete(core::Time stamp) {
  present_ = 0;
  if (has_sample_ && group_start_ <= last_start_) {
    ++stats_.out_of_order;
    return std::nullopt;
  }
  has_sample_ = true;
  last_start_ = group_start_;
  last_end_ = stamp;
  ++stats_.samples;
  core::ImuSample sample;
  sample.stamp = group_start_;
  std::copy_n(values_.begin(), 3, sample.angular_velocity.begin());
  std::copy_n(values_.begin() + 3, 3, sample.linear_acceleration.begin());
  return sample;
}

std::vector<CanFrame> encode_imu_sample(const core::ImuSample& sample, const ImuPreset& preset) {
  std::vector<CanFrame> frames;
  for (std::size_t component = 0; component < kComponents; ++component) {
    const ImuAxis& axis = axis_of(preset.mapping, component);
    const DbcMessage* message = preset.database.find(axis.message);
    const DbcSignal* signal = preset.database.find(axis.message, axis.signal);
    if (message == nullptr || signal == nullptr) continue;
    auto frame = std::find_if(frames.begin(), frames.end(), [&](const CanFrame& f) {
      return f.id == message->id && f.extended == message->extended;
    });
    if (frame == frames.end()) {
      CanFrame next;
      next.stamp = sample.stamp;
      next.id = message->id;
      next.extended = message->extended;
      next.length = static_cast<std::uint8_t>(std::min<std::size_t>(message->length, next.data.size()));
      next.flexible_data_rate = next.length > 8;
      frames.push_back(next);
      frame = std::prev(frames.end());
    }
    const double value =
        component < 3 ? sample.angular_velocity[component] : sample.linear_acceleration[component - 3];
    encode_physical(*signal, value / axis.scale, {frame->data.data(), frame->length});
  }
  return frames;
}

}  // namespace nilio::drivers
