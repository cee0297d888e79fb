#include "drivers/imu/routes.hpp"

#include "nilio/drivers/common/nearest_name.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <span>

namespace nilio::drivers {
namespace {

using core::Error;

/// Shorter signals are flags, which cannot be saturated.
constexpr unsigned kShortestMeasurement = 4;
constexpr std::size_t kMostRoutes = 16;

Error message_missing(const std::string& message, const std::string& use, const DbcDatabase& database) {
  std::vector<std::string> names;
  for (const DbcMessage& candidate : database.messages) names.push_back(candidate.name);
  return {database.path + ": no message '" + message + "' for " + use + nearest_name_hint(message, names)};
}

Error signal_missing(const std::string& signal, const std::string& use, const DbcDatabase& database,
                     const DbcMessage& message) {
  std::vector<std::string> names;
  for (const DbcSignal& candidate : message.signals) names.push_back(candidate.name);
  return {database.path + ": message '" + message.name + "' has no signal '" + signal + "' for " + use +
          nearest_name_hint(signal, names)};
}

/// Error for an existing signal that is unusable, or nothing.
std::optional<Error> check_signal(const std::string& where, const DbcMessage& message,
                                  const DbcSignal& signal) {
  if (signal.multiplexed && !signal.selector) {
    return Error{where + " is multiplexed, but the message has no multiplexer; correct the file"};
  }
  if (message.length > CanFrame{}.data.size()) {
    return Error{where + " is in a message of " + std::to_string(message.length) +
                 " bytes, more than a frame; those cannot be read"};
  }
  if (required_length(signal) > message.length) {
    return Error{where + " does not fit into the message's " + std::to_string(message.length) +
                 " bytes; correct the file"};
  }
  return std::nullopt;
}

/// True at either limit of the raw range; floating-point signals have none.
bool is_at_raw_limit(const DbcSignal& signal, std::int64_t raw) {
  if (signal.value_type != DbcValueType::kInteger || signal.length < kShortestMeasurement) return false;
  const auto bits = static_cast<std::uint64_t>(raw);
  const std::uint64_t ones = ~std::uint64_t{0} >> (64U - signal.length);
  if (!signal.is_signed) return bits == 0 || bits == ones;
  const auto largest = static_cast<std::int64_t>(ones >> 1U);
  return raw == largest || raw == -largest - 1;
}

/// Builds the routes of a mapping; stops at the first error.
class RouteMaker {
 public:
  RouteMaker(const ImuMapping& mapping, const DbcDatabase& database)
      : mapping_(mapping), database_(database) {}

  core::Result<std::vector<ImuRoute>> make() {
    for (std::size_t component = 0; component < kImuComponents; ++component) add_axis(component);
    for (const ImuSignal& counter : mapping_.counters) add_counter(counter);
    for (const ImuStatus& status : mapping_.status) add_status(status, false);
    for (const ImuStatus& status : mapping_.range_status) add_status(status, true);
    if (mapping_.sample_time) add_sample_time(*mapping_.sample_time);
    if (mapping_.temperature) {
      const Place place =
          find(mapping_.temperature->message, mapping_.temperature->signal, "the temperature");
      if (place.route != nullptr) place.route->temperature = place.signal;
    }
    if (error_) return *error_;
    if (routes_.size() > kMostRoutes) return Error{mapping_.name + ": more than 16 messages are mapped"};
    unsigned next = 1U << kImuComponents;
    for (ImuRoute& route : routes_) {
      if (!route.axes.empty() || (!route.counter && !route.ticks && route.status.empty())) continue;
      route.member = next;
      next <<= 1U;
    }
    return std::move(routes_);
  }

 private:
  struct Place {
    ImuRoute* route = nullptr;
    std::size_t signal = 0;
  };

  void add_axis(std::size_t component) {
    const ImuAxis& axis = imu_axis(mapping_, component);
    if (axis.message.empty() && axis.signal.empty()) return;
    const Place place = find(axis.message, axis.signal, imu_component_name(component));
    if (place.route == nullptr) return;
    if (!std::isfinite(axis.scale) || axis.scale == 0.0) {
      error_ = Error{describe(axis.message, axis.signal, imu_component_name(component)) + " has the scale " +
                     std::to_string(axis.scale) + "; give the factor from its unit to SI"};
      return;
    }
    const double stated =
        component < 3 ? mapping_.angular_velocity_range : mapping_.linear_acceleration_range;
    place.route->axes.push_back({.signal = place.signal,
                                 .scale = axis.scale,
                                 .component = component,
                                 .range = stated > 0.0 ? stated : std::numeric_limits<double>::infinity(),
                                 .invalid_from = axis.invalid_from});
  }

  void add_counter(const ImuSignal& counter) {
    const Place place = find(counter.message, counter.signal, "the counter");
    if (place.route != nullptr) place.route->counter = place.signal;
  }

  void add_status(const ImuStatus& status, bool is_range) {
    const Place place = find(status.message, status.signal, "the status");
    if (place.route == nullptr) return;
    place.route->status.push_back({place.signal, status.mask, status.good, is_range});
  }

  void add_sample_time(const ImuSampleTime& time) {
    const Place place = find(time.message, time.signal, "the sample time");
    if (place.route == nullptr) return;
    const bool positive = std::all_of(time.tick_ns.begin(), time.tick_ns.end(),
                                      [](std::int64_t ns) { return ns > 0 && ns <= 1'000'000'000; });
    if (time.tick_ns.empty() || !positive) {
      error_ = Error{describe(time.message, time.signal, "the sample time") +
                     " needs the length of a tick, 1 ns to 1 s"};
      return;
    }
    place.route->ticks = place.signal;
  }

  [[nodiscard]] std::string describe(const std::string& message, const std::string& signal,
                                     const std::string& use) const {
    return database_.path + ": signal '" + signal + "' of message '" + message + "' for " + use +
           " of IMU '" + mapping_.name + "'";
  }

  Place find(const std::string& message_name, const std::string& signal_name, const std::string& what) {
    if (error_) return {};
    const std::string use = what + " of IMU '" + mapping_.name + "'";
    const DbcMessage* message = database_.find(message_name);
    if (message == nullptr) {
      error_ = message_missing(message_name, use, database_);
      return {};
    }
    const DbcSignal* signal = database_.find(message_name, signal_name);
    if (signal == nullptr) {
      error_ = signal_missing(signal_name, use, database_, *message);
      return {};
    }
    error_ = check_signal(describe(message_name, signal_name, what), *message, *signal);
    if (error_) return {};
    return {&route_of(*message), static_cast<std::size_t>(signal - message->signals.data())};
  }

  ImuRoute& route_of(const DbcMessage& message) {
    for (ImuRoute& route : routes_) {
      if (route.message.id == message.id && route.message.extended == message.extended) return route;
    }
    routes_.emplace_back().message = message;
    return routes_.back();
  }

  const ImuMapping& mapping_;
  const DbcDatabase& database_;
  std::vector<ImuRoute> routes_;
  std::optional<Error> error_;
};

}  // namespace

const ImuAxis& imu_axis(const ImuMapping& mapping, std::size_t component) {
  return component < 3 ? mapping.angular_velocity[component] : mapping.linear_acceleration[component - 3];
}

std::string imu_component_name(std::size_t component) {
  const std::string axis(1, "xyz"[component % 3]);
  return (component < 3 ? "angular velocity " : "linear acceleration ") + axis;
}

std::optional<ImuFrameContent> ImuRoute::read(const CanFrame& frame) const {
  const std::span<const std::uint8_t> data(frame.data.data(),
                                           std::min<std::size_t>(frame.length, frame.data.size()));
  ImuFrameContent content;
  // Signals that the multiplexers do not select may be missing; selected ones must be present.
  bool complete = true;
  const auto raw_of = [&](std::size_t index) -> std::optional<std::int64_t> {
    const DbcSignal& signal = message.signals[index];
    if (signal.multiplexed && !is_selected(message, signal, data)) return std::nullopt;
    const std::optional<std::int64_t> raw = decode_raw(signal, data);
    complete = complete && raw.has_value();
    return raw;
  };
  for (const Axis& axis : axes) {
    const std::optional<std::int64_t> raw = raw_of(axis.signal);
    if (!raw) continue;
    const double value = *decode_physical(message.signals[axis.signal], data) * axis.scale;
    if (!std::isfinite(value)) return std::nullopt;
    content.values[axis.component] = value;
    content.present |= 1U << axis.component;
    content.saturated = content.saturated || is_at_raw_limit(message.signals[axis.signal], *raw) ||
                        std::abs(value) >= axis.range;
    content.invalid =
        content.invalid || (axis.invalid_from && static_cast<std::uint64_t>(*raw) >= *axis.invalid_from);
  }
  for (const Status& check : status) {
    const std::optional<std::int64_t> raw = raw_of(check.signal);
    if (!raw || (static_cast<std::uint64_t>(*raw) & check.mask) == check.good) continue;
    (check.is_range ? content.saturated : content.bad_status) = true;
  }
  if (counter) content.counter = raw_of(*counter);
  if (ticks) content.ticks = raw_of(*ticks);
  if (temperature && raw_of(*temperature)) {
    const DbcSignal& signal = message.signals[*temperature];
    const std::optional<double> value = decode_physical(signal, data);
    // Values beyond the limits are codes for "none".
    const bool limited = signal.minimum < signal.maximum;
    if (!limited || (*value >= signal.minimum && *value <= signal.maximum)) content.temperature = value;
  }
  return complete ? std::optional(content) : std::nullopt;
}

core::Result<std::vector<ImuRoute>> make_imu_routes(const ImuMapping& mapping, const DbcDatabase& database) {
  return RouteMaker(mapping, database).make();
}

std::uint32_t j1939_group(std::uint32_t id) {
  constexpr std::uint32_t kFirstBroadcastFormat = 240;
  const std::uint32_t group = (id >> 8U) & 0x3FFFFU;
  return ((group >> 8U) & 0xFFU) < kFirstBroadcastFormat ? group & 0x3FF00U : group;
}

std::string missing_axes(const ImuMapping& mapping) {
  std::string text;
  for (std::size_t component = 0; component < kImuComponents; ++component) {
    const ImuAxis& axis = imu_axis(mapping, component);
    if (!axis.message.empty() || !axis.signal.empty()) continue;
    text += (text.empty() ? "" : ", ") + imu_component_name(component);
  }
  return text;
}

}  // namespace nilio::drivers
