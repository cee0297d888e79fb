#include "azimuth_steps.hpp"

#include "little_endian.hpp"
#include "velodyne_layout.hpp"

#include <algorithm>

namespace nilio::drivers {
namespace {

constexpr int kJitter = 100;
/// The fastest setting is 1200 revolutions per minute.
constexpr double kLargestRatePerSecond = 1300.0 / 60.0 * kAzimuthModulus;
/// A rate that doubled is believed when it stays.
constexpr int kDoubtfulPackets = 3;
/// No pause is longer than a slow revolution.
constexpr double kLongestPauseNs = 250e6;

}  // namespace

int azimuth_advance(std::uint16_t from, std::uint16_t to) {
  int advance = static_cast<int>(to) - static_cast<int>(from);
  if (advance < -kJitter) advance += kAzimuthModulus;
  if (advance >= kAzimuthModulus - kJitter) advance -= kAzimuthModulus;
  return advance;
}

int largest_regular_advance(float rate) { return std::max(kJitter, static_cast<int>(5.0F * rate)); }

AzimuthReader::AzimuthReader(const VelodyneSensor& sensor)
    : flags_(sensor.block_flags),
      blocks_per_azimuth_(sensor.blocks_per_azimuth),
      azimuth_period_ns_(sensor.azimuth_period_ns),
      largest_rate_(
          static_cast<float>(kLargestRatePerSecond * 1e-9 * static_cast<double>(sensor.azimuth_period_ns))) {}

PacketAzimuths AzimuthReader::read(std::span<const std::uint8_t> payload) {
  PacketAzimuths out;
  out.count = kBlocksPerPacket / blocks_per_azimuth_;
  read_steps(payload, out);
  out.rate = rate_of(out);
  drop_outliers(out);
  find_pauses(out);
  return out;
}

void AzimuthReader::read_steps(std::span<const std::uint8_t> payload, PacketAzimuths& out) const {
  for (std::size_t s = 0; s < out.count; ++s) {
    AzimuthStep& step = out.steps[s];
    const std::size_t first = s * blocks_per_azimuth_;
    step.azimuth = load_u16(payload.data() + first * kBlockSize + kAzimuthOffset);
    step.usable = step.azimuth < kAzimuthModulus;
    for (std::size_t b = first; b < first + blocks_per_azimuth_; ++b) {
      const std::uint8_t* block = payload.data() + b * kBlockSize;
      if (load_u16(block) != flags_[b] || load_u16(block + kAzimuthOffset) != step.azimuth)
        step.usable = false;
    }
  }
}

/// The median survives an outlier; a median twice the previous one is doubted for a few packets.
float AzimuthReader::rate_of(const PacketAzimuths& azimuths) {
  std::array<int, kBlocksPerPacket> advances{};
  std::size_t count = 0;
  for (std::size_t s = 1; s < azimuths.count; ++s) {
    if (!azimuths.steps[s - 1].usable || !azimuths.steps[s].usable) continue;
    advances[count++] = azimuth_advance(azimuths.steps[s - 1].azimuth, azimuths.steps[s].azimuth);
  }
  if (count == 0) return rate_;
  const auto middle = advances.begin() + static_cast<std::ptrdiff_t>(count / 2);
  std::nth_element(advances.begin(), middle, advances.begin() + static_cast<std::ptrdiff_t>(count));
  const float median = std::clamp(static_cast<float>(*middle), 0.0F, largest_rate_);
  if (rate_ > 0.0F && median > 2.0F * rate_ && doubtful_packets_ < kDoubtfulPackets) {
    ++doubtful_packets_;
    return rate_;
  }
  doubtful_packets_ = 0;
  rate_ = median;
  return rate_;
}

/// A step that continues neither the step before nor into the step after is an outlier.
void AzimuthReader::drop_outliers(PacketAzimuths& out) const {
  const int largest = largest_regular_advance(out.rate);
  std::array<bool, kBlocksPerPacket> connected{};
  for (std::size_t s = 1; s < out.count; ++s) {
    if (!out.steps[s - 1].usable || !out.steps[s].usable) continue;
    if (azimuth_advance(out.steps[s - 1].azimuth, out.steps[s].azimuth) > largest) continue;
    connected[s - 1] = true;
    connected[s] = true;
  }
  for (std::size_t s = 0; s < out.count; ++s) {
    out.steps[s].usable = connected[s];
    if (!connected[s]) out.bad_blocks += static_cast<std::uint32_t>(blocks_per_azimuth_);
  }
}

/// A packet is sent when it is full: with a restricted field of view its later blocks can be fired much later
/// than the stamp says. The azimuth that was skipped tells how much.
void AzimuthReader::find_pauses(PacketAzimuths& out) const {
  const int largest = largest_regular_advance(out.rate);
  std::size_t previous = out.count;
  for (std::size_t s = 0; s < out.count; ++s) {
    if (!out.steps[s].usable) continue;
    if (previous < out.count) {
      const int steps = static_cast<int>(s - previous);
      const int advance = azimuth_advance(out.steps[previous].azimuth, out.steps[s].azimuth);
      if (advance > largest * steps && out.rate > 0.0F) {
        const double skipped = static_cast<double>(advance) / static_cast<double>(out.rate) - steps;
        const double pause = std::min(skipped * static_cast<double>(azimuth_period_ns_), kLongestPauseNs);
        out.pause_ns = std::min(out.pause_ns + static_cast<std::int64_t>(pause),
                                static_cast<std::int64_t>(kLongestPauseNs));
      }
    }
    out.steps[s].pause_ns = out.pause_ns;
    previous = s;
  }
}

}  // namespace nilio::drivers
