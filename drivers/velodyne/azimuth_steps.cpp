#include "drivers/velodyne/azimuth_steps.hpp"

#include "drivers/common/byte_order.hpp"
#include "drivers/velodyne/packet_bytes.hpp"

#include <algorithm>
#include <cstdlib>
#include <numeric>

namespace nilio::drivers {
namespace {

/// Largest step back by jitter, 0.01 degree.
constexpr int kJitter = 100;
/// Jitter of the azimuth at constant speed, 0.01 degree.
constexpr int kAzimuthJitter = 9;
/// Above the fastest setting, 1200 revolutions per minute.
constexpr double kLargestRatePerSecond = 1300.0 / 60.0 * kAzimuthModulus;
/// A doubled rate is accepted after so many packets.
constexpr int kPacketsToAccept = 3;
/// Longest pause: a slow revolution.
constexpr double kLongestPauseNs = 250e6;

}  // namespace

int azimuth_advance(std::uint16_t from, std::uint16_t to) {
  int advance = static_cast<int>(to) - static_cast<int>(from);
  if (advance < -kJitter) advance += kAzimuthModulus;
  if (advance >= kAzimuthModulus - kJitter) advance -= kAzimuthModulus;
  return advance;
}

int largest_regular_advance(float rate) { return std::max(kJitter, static_cast<int>(5.0F * rate)); }

void AzimuthReader::set_layout(const PacketLayout& layout) {
  layout_ = layout;
  rate_ = 0.0F;
  unaccepted_packets_ = 0;
  has_last_azimuth_ = false;
  set_period(layout.azimuth_period_ns);
}

void AzimuthReader::set_period(std::int64_t azimuth_period_ns) {
  azimuth_period_ns_ = azimuth_period_ns;
  largest_rate_ = static_cast<float>(kLargestRatePerSecond * 1e-9 * static_cast<double>(azimuth_period_ns));
}

PacketAzimuths AzimuthReader::read(std::span<const std::uint8_t> payload, std::int64_t since_previous_ns,
                                   const BlindSector& blind) {
  PacketAzimuths out;
  out.count = layout_.azimuth_steps();
  read_steps(payload, out);
  update_rate(advance_per_step(out, since_previous_ns));
  out.rate = rate_;
  drop_outliers(out, blind);
  find_pauses(out);
  has_last_azimuth_ = out.steps[out.count - 1].usable;
  last_azimuth_ = out.steps[out.count - 1].azimuth;
  return out;
}

void AzimuthReader::read_steps(std::span<const std::uint8_t> payload, PacketAzimuths& out) const {
  const std::size_t blocks = layout_.blocks_per_azimuth;
  for (std::size_t s = 0; s < out.count; ++s) {
    AzimuthStep& step = out.steps[s];
    step.azimuth = load_le16(payload.data() + s * blocks * kBlockSize + kAzimuthOffset);
    step.usable = step.azimuth <= kAzimuthModulus;
    for (std::size_t b = s * blocks; b < (s + 1) * blocks; ++b) {
      if (layout_.contents[b] == BlockContent::kPadding || layout_.contents[b] == BlockContent::kConfidence)
        continue;
      const std::uint8_t* block = payload.data() + b * kBlockSize;
      if (load_le16(block) != layout_.block_flags[b] || load_le16(block + kAzimuthOffset) != step.azimuth)
        step.usable = false;
    }
    // Sensors occasionally send 36000.
    if (step.azimuth == kAzimuthModulus) step.azimuth = 0;
  }
}

/// Mean of the packet's advances near their median: robust to outliers, finer than the azimuth's unit.
/// Negative = unknown.
float AzimuthReader::advance_per_step(const PacketAzimuths& azimuths, std::int64_t since_previous_ns) const {
  if (azimuths.count == 1) {
    const bool known = has_last_azimuth_ && azimuths.steps[0].usable && since_previous_ns > 0;
    if (!known) return -1.0F;
    const double periods = static_cast<double>(since_previous_ns) / static_cast<double>(azimuth_period_ns_);
    return static_cast<float>(azimuth_advance(last_azimuth_, azimuths.steps[0].azimuth) / periods);
  }
  std::array<int, kBlocksPerPacket> advances{};
  std::size_t count = 0;
  for (std::size_t s = 1; s < azimuths.count; ++s) {
    if (!azimuths.steps[s - 1].usable || !azimuths.steps[s].usable) continue;
    advances[count++] = azimuth_advance(azimuths.steps[s - 1].azimuth, azimuths.steps[s].azimuth);
  }
  if (count == 0) return -1.0F;
  const auto used = advances.begin() + static_cast<std::ptrdiff_t>(count);
  const auto [least, most] = std::minmax_element(advances.begin(), used);
  // Without outliers all are near the median.
  if (*most - *least <= kAzimuthJitter)
    return static_cast<float>(std::accumulate(advances.begin(), used, 0)) / static_cast<float>(count);
  const auto middle = advances.begin() + static_cast<std::ptrdiff_t>(count / 2);
  std::nth_element(advances.begin(), middle, used);
  const int median = *middle;
  const int spread = std::max(median / 2, kAzimuthJitter);
  int sum = 0;
  int near = 0;
  for (std::size_t i = 0; i < count; ++i) {
    if (std::abs(advances[i] - median) > spread) continue;
    sum += advances[i];
    ++near;
  }
  return static_cast<float>(sum) / static_cast<float>(near);
}

/// A rate above twice the previous one is accepted after a few packets only.
void AzimuthReader::update_rate(float advance) {
  if (advance < 0.0F) return;
  const float limited = std::min(advance, largest_rate_);
  if (rate_ > 0.0F && limited > 2.0F * rate_ && unaccepted_packets_ < kPacketsToAccept) {
    ++unaccepted_packets_;
    return;
  }
  unaccepted_packets_ = 0;
  rate_ = limited;
}

/// Marks steps as bad that no other step confirms: of two steps each predicts the other's azimuth by the
/// rate.
void AzimuthReader::drop_outliers(PacketAzimuths& out, const BlindSector& blind) const {
  if (out.count == 1) {
    out.bad_steps = out.steps[0].usable ? 0 : 1;
    return;
  }
  const auto is_predicted = [&](std::uint16_t from, std::uint16_t to, std::size_t steps) {
    const float predicted = out.rate * static_cast<float>(steps);
    return std::abs(static_cast<float>(azimuth_advance(from, to)) - predicted) <= static_cast<float>(kJitter);
  };
  const auto agree = [&](std::size_t a, std::size_t b) {
    return out.steps[a].usable && out.steps[b].usable &&
           is_predicted(out.steps[a].azimuth, out.steps[b].azimuth, b - a);
  };
  std::array<bool, kBlocksPerPacket> confirmed{};
  // At a packet's ends the neighbour is in another packet, or beyond the blind sector.
  const AzimuthStep& first = out.steps[0];
  confirmed[0] = first.usable && has_last_azimuth_ && is_predicted(last_azimuth_, first.azimuth, 1);
  const AzimuthStep& last = out.steps[out.count - 1];
  confirmed[out.count - 1] = last.usable && blind.ends_at(last.azimuth);
  for (std::size_t s = 1; s < out.count; ++s) {
    // Nearly always the previous step agrees; after a damaged one, a step before that.
    for (std::size_t p = s; p-- > 0 && !confirmed[s];) {
      if (agree(p, s)) confirmed[p] = confirmed[s] = true;
    }
    if (confirmed[s] && !confirmed[s - 1]) confirmed[s - 1] = agree(s - 1, s);
  }
  for (std::size_t s = 0; s < out.count; ++s) {
    out.steps[s].usable = confirmed[s];
    if (!confirmed[s]) ++out.bad_steps;
  }
}

/// Computes firing pauses. A packet is sent when it is full: with a restricted field of view its later blocks
/// can be fired long after the stamp. The skipped azimuth gives the delay.
void AzimuthReader::find_pauses(PacketAzimuths& out) const {
  const int largest = largest_regular_advance(out.rate);
  std::size_t previous = out.count;
  for (std::size_t s = 0; s < out.count; ++s) {
    if (!out.steps[s].usable) continue;
    if (previous < out.count) {
      const int steps = static_cast<int>(s - previous);
      const int advance = azimuth_advance(out.steps[previous].azimuth, out.steps[s].azimuth);
      if (advance > largest * steps && out.rate > 0.0F) {
        if (steps == 1) out.gap_from_step = s;
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
