#include "tools/play/restamp.hpp"

#include <cstddef>

namespace nilio::tools {

namespace {

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

void Restamper::apply(drivers::Packet& packet, core::Time host_now) {
  std::uint8_t* time = nullptr;
  if (packet.size == kDataSize) time = packet.data.data() + kDataTimeOffset;
  if (packet.size == kPositionSize) time = packet.data.data() + kPositionTimeOffset;
  if (time == nullptr) return;
  // Sensors count a little beyond the hour.
  const std::uint64_t sensor_us = load_time(time) % kHourUs;
  if (!offset_us_) {
    const std::uint64_t host_us = static_cast<std::uint64_t>(host_now.ns / 1000) % kHourUs;
    offset_us_ = (host_us + kHourUs - sensor_us) % kHourUs;
  }
  store_time(time, (sensor_us + *offset_us_) % kHourUs);
}

}  // namespace nilio::tools
