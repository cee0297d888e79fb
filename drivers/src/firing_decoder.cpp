#include "firing_decoder.hpp"

#include "little_endian.hpp"
#include "velodyne_layout.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace nilio::drivers {
namespace {

constexpr double kRadiansPerAzimuth = std::numbers::pi / 18000.0;
/// A range limit of exactly so many metres is meant to be inside, whatever the division rounds to.
constexpr double kRounding = 1e-6;

}  // namespace

FiringDecoder::FiringDecoder(const VelodyneSensor& sensor, double min_range_m, double max_range_m)
    : resolution_(static_cast<float>(sensor.distance_resolution_m)),
      lanes_(sensor.blocks_per_azimuth),
      azimuths_(kAzimuthModulus) {
  for (std::size_t i = 0; i < azimuths_.size(); ++i) {
    const double angle = static_cast<double>(i) * kRadiansPerAzimuth;
    azimuths_[i] = {static_cast<float>(std::sin(angle)), static_cast<float>(std::cos(angle))};
  }
  for (std::size_t b = 0; b < lanes_.size(); ++b) {
    for (std::size_t c = 0; c < kEntriesPerBlock; ++c) {
      fill_entry(sensor, sensor.entries[b][c], min_range_m, max_range_m, lanes_[b], c);
      interpolated_ = interpolated_ || sensor.entries[b][c].azimuth_fraction != 0.0F;
    }
  }
  fill_times(sensor);
}

void FiringDecoder::fill_entry(const VelodyneSensor& sensor, const PacketEntry& entry, double min_range_m,
                               double max_range_m, Lane& lane, std::size_t c) const {
  const LaserCalibration& laser = sensor.lasers[entry.laser];
  const double cos_elevation = std::cos(laser.elevation_rad);
  const double sin_elevation = std::sin(laser.elevation_rad);
  const bool across = sensor.vertical_offset_across_beam;
  lane.distance_correction[c] = static_cast<float>(laser.distance_correction_m);
  lane.cos_elevation[c] = static_cast<float>(cos_elevation);
  lane.sin_elevation[c] = static_cast<float>(sin_elevation);
  lane.range_offset[c] = static_cast<float>(across ? -laser.vertical_offset_m * sin_elevation : 0.0);
  lane.height_offset[c] =
      static_cast<float>(across ? laser.vertical_offset_m * cos_elevation : laser.vertical_offset_m);
  lane.side_offset[c] = static_cast<float>(laser.horizontal_offset_m);
  lane.cos_correction[c] = static_cast<float>(std::cos(-laser.azimuth_correction_rad));
  lane.sin_correction[c] = static_cast<float>(std::sin(-laser.azimuth_correction_rad));
  lane.cos_shift[c] = lane.cos_correction[c];
  lane.sin_shift[c] = lane.sin_correction[c];
  lane.fraction[c] = entry.azimuth_fraction;
  lane.ring[c] = laser.ring;
  const double low = (min_range_m - laser.distance_correction_m) / sensor.distance_resolution_m;
  const double high = (max_range_m - laser.distance_correction_m) / sensor.distance_resolution_m;
  lane.min_raw[c] = static_cast<std::int32_t>(std::clamp(std::ceil(low - kRounding), 1.0, 65536.0));
  lane.max_raw[c] = static_cast<std::int32_t>(std::clamp(std::floor(high + kRounding), 0.0, 65535.0));
}

void FiringDecoder::fill_times(const VelodyneSensor& sensor) {
  for (std::size_t b = 0; b < kBlocksPerPacket; ++b) {
    const std::size_t step = b / lanes_.size();
    const bool first_of_step = b % lanes_.size() == 0;
    for (std::size_t c = 0; c < kEntriesPerBlock; ++c) {
      const std::int32_t time = sensor.entries[b][c].time_offset_ns;
      times_[b][c] = time;
      const bool first = first_of_step && c == 0;
      first_firing_ns_[step] = first ? time : std::min(first_firing_ns_[step], time);
      last_firing_ns_[step] = first ? time : std::max(last_firing_ns_[step], time);
    }
  }
}

void FiringDecoder::set_rate(float rate) {
  if (!interpolated_ || rate == rate_) return;
  rate_ = rate;
  const float step = rate * static_cast<float>(kRadiansPerAzimuth);
  for (Lane& lane : lanes_) {
    for (std::size_t c = 0; c < kEntriesPerBlock; ++c) {
      // At most one degree: the series is exact to single precision.
      const float angle = step * lane.fraction[c];
      const float squared = angle * angle;
      const float sin = angle * (1.0F - squared / 6.0F);
      const float cos = 1.0F - squared / 2.0F + squared * squared / 24.0F;
      lane.sin_shift[c] = sin * lane.cos_correction[c] + cos * lane.sin_correction[c];
      lane.cos_shift[c] = cos * lane.cos_correction[c] - sin * lane.sin_correction[c];
    }
  }
}

FiringDecoder::Counts FiringDecoder::decode_block(const std::uint8_t* block, std::size_t index,
                                                  std::int32_t time_ns, std::span<core::Point> points) const {
  const Lane& lane = lanes_[index % lanes_.size()];
  const SinCos azimuth = azimuths_[load_u16(block + kAzimuthOffset)];
  // Distance and intensity of an entry together; the last entry of a packet's last block is followed by the
  // time stamp.
  std::array<std::uint32_t, kEntriesPerBlock> words;
  for (std::size_t c = 0; c < kEntriesPerBlock; ++c)
    words[c] = load_u32(block + kEntriesOffset + kEntrySize * c);
  Row x;
  Row y;
  Row z;
  Row intensity;
  std::array<std::int32_t, kEntriesPerBlock> in_range;
  std::int32_t returns = 0;
  // Separate from the selection below so that it vectorises.
  for (std::size_t c = 0; c < kEntriesPerBlock; ++c) {
    const auto raw = static_cast<std::int32_t>(words[c] & 0xFFFFU);
    const float distance = static_cast<float>(raw) * resolution_ + lane.distance_correction[c];
    const float range = distance * lane.cos_elevation[c] + lane.range_offset[c];
    const float sin = azimuth.sin * lane.cos_shift[c] + azimuth.cos * lane.sin_shift[c];
    const float cos = azimuth.cos * lane.cos_shift[c] - azimuth.sin * lane.sin_shift[c];
    x[c] = range * cos + lane.side_offset[c] * sin;
    y[c] = lane.side_offset[c] * cos - range * sin;
    z[c] = distance * lane.sin_elevation[c] + lane.height_offset[c];
    intensity[c] = static_cast<float>(static_cast<std::int32_t>((words[c] >> 16) & 0xFFU));
    in_range[c] =
        static_cast<std::int32_t>(raw >= lane.min_raw[c]) & static_cast<std::int32_t>(raw <= lane.max_raw[c]);
    returns += static_cast<std::int32_t>(raw != 0);
  }
  Counts counts;
  const std::array<std::int32_t, kEntriesPerBlock>& times = times_[index];
  core::Point* out = points.data();
  for (std::size_t c = 0; c < kEntriesPerBlock; ++c) {
    // Written always, kept only when it counts: no branch to mispredict. There is always room for one more.
    *out = {.x = x[c],
            .y = y[c],
            .z = z[c],
            .intensity = intensity[c],
            .time_offset_ns = time_ns + times[c],
            .ring = lane.ring[c]};
    out += in_range[c];
  }
  counts.points = static_cast<std::size_t>(out - points.data());
  counts.out_of_range = static_cast<std::size_t>(returns) - counts.points;
  return counts;
}

}  // namespace nilio::drivers
