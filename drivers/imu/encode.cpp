#include "nilio/drivers/imu/decoder.hpp"

#include "drivers/imu/routes.hpp"

#include <algorithm>
#include <cmath>
#include <span>

namespace nilio::drivers {
namespace {

/// Writes a raw value into its bits; higher bits are cut off.
void encode_raw(const DbcSignal& signal, std::uint64_t raw, std::span<std::uint8_t> data) {
  // Without scale and sign the physical value is the raw one; doubles are exact to 53 bits.
  DbcSignal plain = signal;
  plain.factor = 1.0;
  plain.offset = 0.0;
  plain.is_signed = false;
  const std::uint64_t ones = ~std::uint64_t{0} >> (64U - signal.length);
  encode_physical(plain, static_cast<double>(raw & ones), data);
}

/// Sets status, time and counter of a message.
void encode_metadata(const ImuRoute& route, const ImuPreset& preset, core::Time stamp,
                     std::optional<std::uint64_t> number, std::span<std::uint8_t> data) {
  const std::vector<DbcSignal>& signals = route.message.signals;
  for (const ImuRoute::Status& status : route.status) encode_raw(signals[status.signal], status.good, data);
  if (route.ticks) {
    const ImuSampleTime& time = *preset.mapping.sample_time;
    const auto ticks = static_cast<std::uint64_t>(stamp.ns / time.tick_ns.front());
    encode_raw(signals[*route.ticks], time.wrap != 0 ? ticks % time.wrap : ticks, data);
  }
  if (!route.counter) return;
  const double cycle_ns = route.message.cycle_ms * 1e6;
  const double cycles = cycle_ns > 0.0 ? std::round(static_cast<double>(stamp.ns) / cycle_ns) : 0.0;
  encode_raw(signals[*route.counter], number.value_or(static_cast<std::uint64_t>(std::max(cycles, 0.0))),
             data);
}

CanFrame empty_frame(const ImuRoute& route, const ImuMapping& mapping, core::Time stamp) {
  CanFrame frame;
  frame.stamp = stamp;
  frame.id = route.message.id;
  if (route.message.j1939 && mapping.source_address) frame.id = (frame.id & ~0xFFU) | *mapping.source_address;
  frame.extended = route.message.extended;
  frame.length = static_cast<std::uint8_t>(std::min<std::size_t>(route.message.length, frame.data.size()));
  frame.flexible_data_rate = route.message.flexible_data_rate || frame.length > 8;
  return frame;
}

}  // namespace

std::vector<CanFrame> encode_imu_sample(const core::ImuSample& sample, const ImuPreset& preset,
                                        std::optional<std::uint64_t> number) {
  std::vector<CanFrame> frames;
  const core::Result<std::vector<ImuRoute>> routes = make_imu_routes(preset.mapping, preset.database);
  if (!routes) return frames;
  for (const ImuRoute& route : *routes) {
    if (route.axes.empty()) continue;
    CanFrame frame = empty_frame(route, preset.mapping, sample.stamp);
    const std::span<std::uint8_t> data(frame.data.data(), frame.length);
    for (const ImuRoute::Axis& axis : route.axes) {
      const double value = axis.component < 3 ? sample.angular_velocity[axis.component]
                                              : sample.linear_acceleration[axis.component - 3];
      encode_physical(route.message.signals[axis.signal], value / axis.scale, data);
    }
    encode_metadata(route, preset, sample.stamp, number, data);
    frames.push_back(frame);
  }
  return frames;
}

}  // namespace nilio::drivers
