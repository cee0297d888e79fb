#include "tools/simulate/sensors/sensor_timing.hpp"

#include "tools/simulate/random.hpp"

#include <algorithm>
#include <cmath>

namespace nilio::tools::simulate {

namespace {

constexpr std::int64_t kMicrosecondNs = 1000;
constexpr std::int64_t kHourUs = 3'600'000'000;
constexpr std::uint64_t kRestStream = 0x52657374;
constexpr std::uint64_t kJitterStream = 0x4A6974746572;
/// A VLS-128 pauses after each firing sequence for a random time with this mean (manual 63-9483).
constexpr std::int64_t kMeanRestNs = 1'940;

std::int64_t floor_to_microsecond(std::int64_t ns) {
  const std::int64_t past = ns % kMicrosecondNs;
  return ns - past - (past < 0 ? kMicrosecondNs : 0);
}

}  // namespace

SensorTiming::SensorTiming(const drivers::VelodyneSensor& sensor, const drivers::PacketLayout& layout,
                           const SensorTimingConfig& config)
    : config_(config), steps_(layout.azimuth_steps()), step_period_ns_(layout.azimuth_period_ns) {
  config_.clock_offset.ns = floor_to_microsecond(config.clock_offset.ns + kMicrosecondNs / 2);
  if (sensor.model == drivers::VelodyneModel::kVls128) {
    step_period_ns_ += kMeanRestNs;
    // Each sequence is delayed by at most the mean, so that no pause is negative.
    rest_jitter_ns_ = kMeanRestNs;
  }
  for (std::size_t block = 0; block < layout.blocks_per_azimuth; ++block) {
    for (const drivers::PacketEntry& entry : layout.entries[block])
      last_offset_ns_ = std::max<std::int64_t>(last_offset_ns_, entry.time_offset_ns);
  }
}

/// Sensor time since the start.
std::int64_t SensorTiming::sequence_ns(std::uint64_t sequence) const {
  const std::int64_t even_ns = static_cast<std::int64_t>(sequence) * step_period_ns_;
  if (rest_jitter_ns_ == 0) return even_ns;
  const double share = to_unit_interval(random_word(config_.seed ^ kRestStream, sequence));
  return even_ns + std::llround(share * static_cast<double>(rest_jitter_ns_));
}

std::int64_t SensorTiming::to_true_ns(std::int64_t sensor_ns) const {
  return std::llround(static_cast<double>(sensor_ns) / (1.0 + config_.clock_drift_ppm * 1e-6));
}

core::Time SensorTiming::sensor_clock(std::uint64_t packet) const {
  // The packet's clock counts whole microseconds; firings are relative to it.
  return config_.start + config_.clock_offset +
         core::Duration{floor_to_microsecond(sequence_ns(packet * steps_))};
}

core::Duration SensorTiming::step_time(std::uint64_t packet, std::size_t step) const {
  const std::int64_t first_ns = sequence_ns(packet * steps_);
  const std::int64_t since_ns = sequence_ns(packet * steps_ + step) - first_ns;
  return {to_true_ns(floor_to_microsecond(first_ns) + since_ns)};
}

core::Duration SensorTiming::last_firing(std::uint64_t packet) const {
  return step_time(packet, steps_ - 1) + core::Duration{last_offset_ns_};
}

core::Time SensorTiming::received(std::uint64_t packet) const {
  const auto arrival = [&](std::uint64_t index) {
    const double share = to_unit_interval(random_word(config_.seed ^ kJitterStream, index));
    const auto delay_ns = std::llround(share * static_cast<double>(config_.network_jitter.ns));
    return config_.start + last_firing(index) + kTransmission + core::Duration{delay_ns};
  };
  core::Time latest = arrival(packet);
  // A packet waits for earlier ones; only these can be late enough.
  const auto queue = static_cast<std::uint64_t>(config_.network_jitter.ns / packet_period().ns + 1);
  for (std::uint64_t back = 1; back <= std::min(queue, packet) && config_.network_jitter.ns > 0; ++back)
    latest = std::max(latest, arrival(packet - back));
  return latest;
}

core::Time SensorTiming::sensor_clock_at(core::Duration time) const {
  const double sensor_ns = static_cast<double>(time.ns) * (1.0 + config_.clock_drift_ppm * 1e-6);
  return config_.start + config_.clock_offset + core::Duration{floor_to_microsecond(std::llround(sensor_ns))};
}

core::Duration SensorTiming::packet_period() const {
  return {to_true_ns(static_cast<std::int64_t>(steps_) * step_period_ns_)};
}

std::uint32_t timestamp_us(core::Time sensor_clock) {
  return static_cast<std::uint32_t>(sensor_clock.ns / kMicrosecondNs % kHourUs);
}

}  // namespace nilio::tools::simulate
