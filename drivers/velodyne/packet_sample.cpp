#include "drivers/velodyne/packet_sample.hpp"

#include "nilio/drivers/velodyne/model.hpp"
#include "nilio/drivers/velodyne/packet.hpp"

#include "drivers/common/byte_order.hpp"
#include "drivers/velodyne/clock/sensor_clock.hpp"
#include "drivers/velodyne/packet_bytes.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace nilio::drivers {
namespace {

/// Two packets less than a revolution apart; the fastest setting is 1200 revolutions per minute.
constexpr double kWithinRevolutionUs = 45'000.0;
/// Slower than half the slowest setting of 300 revolutions per minute counts as stopped; 0.01 degree per us.
constexpr double kStoppedRate = 0.5 * 300.0 / 60e6 * kAzimuthModulus;
/// Steps of an encoder that is read in 0.09 degrees differ by up to this, 0.01 degree.
constexpr double kEncoderStep = 9.0;
/// Share of the steps of time that are like the median when all packets arrive.
constexpr double kRegularShare = 0.8;

std::uint32_t timestamp_of(const Packet& packet) { return load_le32(packet.data.data() + kTimestampOffset); }

int azimuth_of(const Packet& packet, std::size_t block) {
  return load_le16(packet.data.data() + block * kBlockSize + kAzimuthOffset);
}

int forward(int from, int to) { return ((to - from) % kAzimuthModulus + kAzimuthModulus) % kAzimuthModulus; }

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

std::vector<double> times_between(const PacketSample& sample) {
  std::vector<double> times;
  for (std::size_t i = 1; i < sample.packets.size(); ++i) {
    times.push_back(1e-3 * static_cast<double>(hour_difference_ns(timestamp_of(*sample.packets[i]),
                                                                  timestamp_of(*sample.packets[i - 1]))));
  }
  return times;
}

/// Mean advance between neighbouring steps of a packet, without outliers (a blind sector, damage); 0.01
/// degree.
double advance_in_packets(const PacketSample& sample, std::size_t blocks_per_step) {
  std::vector<double> advances;
  for (const Packet* packet : sample.packets) {
    for (std::size_t b = blocks_per_step; b < kBlocksPerPacket; b += blocks_per_step)
      advances.push_back(forward(azimuth_of(*packet, b - blocks_per_step), azimuth_of(*packet, b)));
  }
  if (advances.empty()) return 0.0;
  const double middle = median(advances);
  const double spread = std::max(0.5 * middle, kEncoderStep);
  double sum = 0.0;
  double count = 0.0;
  for (const double advance : advances) {
    if (std::abs(advance - middle) > spread) continue;
    sum += advance;
    ++count;
  }
  return sum / count;
}

/// Turning rate between packets without outliers, 0.01 degree per us.
double turning_rate(const PacketSample& sample) {
  const std::vector<double> times = times_between(sample);
  std::vector<double> rates;
  for (std::size_t i = 0; i < times.size(); ++i) {
    if (times[i] <= 0.0 || times[i] > kWithinRevolutionUs) continue;
    rates.push_back(forward(azimuth_of(*sample.packets[i], 0), azimuth_of(*sample.packets[i + 1], 0)) /
                    times[i]);
  }
  if (rates.empty()) return 0.0;
  const double middle = median(rates);
  double turned = 0.0;
  double took_us = 0.0;
  for (std::size_t i = 0; i < times.size(); ++i) {
    if (times[i] <= 0.0 || times[i] > kWithinRevolutionUs) continue;
    const int advance = forward(azimuth_of(*sample.packets[i], 0), azimuth_of(*sample.packets[i + 1], 0));
    const double expected = middle * times[i];
    if (std::abs(advance - expected) > 0.25 * expected + kEncoderStep) continue;
    turned += advance;
    took_us += times[i];
  }
  return took_us > 0.0 ? turned / took_us : 0.0;
}

}  // namespace

PacketSample make_sample(std::span<const Packet> packets) {
  PacketSample sample;
  for (const Packet& packet : packets) {
    if (!is_data_packet(packet)) continue;
    const bool is_copy = std::any_of(sample.packets.begin(), sample.packets.end(), [&](const Packet* other) {
      return std::equal(packet.data.begin(), packet.data.begin() + kDataPacketSize, other->data.begin());
    });
    if (!is_copy) sample.packets.push_back(&packet);
  }
  const std::vector<double> times = times_between(sample);
  if (times.empty()) return sample;
  const auto near = std::count_if(times.begin(), times.end(), [](double time_us) {
    return time_us != 0.0 && std::abs(time_us) * 1e3 < static_cast<double>(kReorderWindowNs);
  });
  sample.ticks = 2 * static_cast<std::size_t>(near) >= times.size();
  if (!*sample.ticks) return sample;
  const std::uint32_t first_us = timestamp_of(*sample.packets.front());
  std::stable_sort(sample.packets.begin(), sample.packets.end(), [&](const Packet* a, const Packet* b) {
    return hour_difference_ns(timestamp_of(*a), first_us) < hour_difference_ns(timestamp_of(*b), first_us);
  });
  return sample;
}

double azimuth_step_us(const PacketSample& sample, std::size_t blocks_per_step) {
  if (sample.ticks != true) return 0.0;
  const double rate = turning_rate(sample);
  return rate < kStoppedRate ? 0.0 : advance_in_packets(sample, blocks_per_step) / rate;
}

double regular_packet_period_us(const PacketSample& sample) {
  if (sample.ticks != true) return 0.0;
  const std::vector<double> times = times_between(sample);
  if (times.size() < 3) return 0.0;
  const double middle = median(times);
  const auto alike = std::count_if(times.begin(), times.end(), [&](double time_us) {
    return std::abs(time_us - middle) <= 2.0 + 0.1 * middle;
  });
  return static_cast<double>(alike) >= kRegularShare * static_cast<double>(times.size()) ? middle : 0.0;
}

}  // namespace nilio::drivers
