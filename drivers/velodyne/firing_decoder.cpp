#include "drivers/velodyne/firing_decoder.hpp"

#include "nilio/core/portable_math.hpp"

#include "drivers/common/byte_order.hpp"
#include "drivers/velodyne/packet_bytes.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <numbers>

namespace nilio::drivers {
namespace {

constexpr double kRadiansPerAzimuth = std::numbers::pi / 18000.0;
/// Rounding margin that includes ranges exactly at a limit.
constexpr double kRounding = 1e-6;

/// Distances of the HDL-64E's two-point calibration, m.
constexpr double kFarCalibration = 25.04;
constexpr double kNearCalibrationX = 2.40;
constexpr double kNearCalibrationY = 1.93;
/// Scale of the focal distance, m.
constexpr double kFocalRange = 131.0;

std::uint32_t distance_of(std::uint32_t word) { return word & 0xFFFFU; }
std::uint32_t intensity_of(std::uint32_t word) { return (word >> 16) & 0xFFU; }

/// Loads distance and intensity of each entry as one word. Reading beyond the last block's last entry is
/// safe: the time stamp follows it.
std::array<std::uint32_t, kEntriesPerBlock> load_entries(const std::uint8_t* block) {
  std::array<std::uint32_t, kEntriesPerBlock> words;
#pragma GCC unroll 32
  for (std::size_t c = 0; c < kEntriesPerBlock; ++c)
    words[c] = load_le32(block + kEntriesOffset + kEntrySize * c);
  return words;
}

}  // namespace

AzimuthTable::AzimuthTable() : values_(kAzimuthModulus + 1) {
  for (std::size_t i = 0; i < values_.size(); ++i) {
    const double angle = static_cast<double>(i) * kRadiansPerAzimuth;
    values_[i] = {static_cast<float>(portable::sin(angle)), static_cast<float>(portable::cos(angle))};
  }
}

FiringDecoder::FiringDecoder(const VelodyneSensor& sensor, const PacketLayout& layout,
                             const AzimuthTable& azimuths, double min_range_m, double max_range_m,
                             ReturnChoice returns)
    : resolution_(static_cast<float>(sensor.distance_resolution_m)),
      returns_(returns),
      blocks_per_step_(layout.blocks_per_azimuth),
      tables_(layout.blocks_per_azimuth),
      azimuths_(&azimuths) {
  for (std::size_t b = 0; b < tables_.size(); ++b) fill_table(sensor, layout, min_range_m, max_range_m, b);
  fill_times();
}

void FiringDecoder::fill_table(const VelodyneSensor& sensor, const PacketLayout& layout, double min_range_m,
                               double max_range_m, std::size_t block) {
  BlockTable& table = tables_[block];
  table.content = layout.contents[block];
  table.partner = block;
  for (std::size_t other = 0; other < tables_.size(); ++other) {
    const bool other_return =
        layout.contents[other] == BlockContent::kLast || layout.contents[other] == BlockContent::kStrongest;
    if (other != block && other_return && layout.block_flags[other] == layout.block_flags[block])
      table.partner = other;
  }
  for (std::size_t c = 0; c < kEntriesPerBlock; ++c) {
    const PacketEntry& entry = layout.entries[block][c];
    const LaserCalibration& laser = sensor.lasers[entry.laser];
    const double cos_elevation = portable::cos(laser.elevation_rad);
    const double sin_elevation = portable::sin(laser.elevation_rad);
    const bool across = sensor.vertical_offset_across_beam;
    const double far = laser.distance_correction_m;
    table.distance_correction[c] = static_cast<float>(far);
    table.cos_elevation[c] = static_cast<float>(cos_elevation);
    table.sin_elevation[c] = static_cast<float>(sin_elevation);
    table.range_offset[c] = static_cast<float>(across ? -laser.vertical_offset_m * sin_elevation : 0.0);
    table.height_offset[c] =
        static_cast<float>(across ? laser.vertical_offset_m * cos_elevation : laser.vertical_offset_m);
    table.side_offset[c] = static_cast<float>(laser.horizontal_offset_m);
    table.cos_correction[c] = static_cast<float>(portable::cos(-laser.azimuth_correction_rad));
    table.sin_correction[c] = static_cast<float>(portable::sin(-laser.azimuth_correction_rad));
    table.cos_shift[c] = table.cos_correction[c];
    table.sin_shift[c] = table.sin_correction[c];
    table.fraction[c] = entry.azimuth_fraction;
    table.ring[c] = laser.ring;
    if (laser.near_distance_correction_x_m != 0.0 || laser.near_distance_correction_y_m != 0.0) {
      const double slope_x =
          (far - laser.near_distance_correction_x_m) / (kFarCalibration - kNearCalibrationX);
      const double slope_y =
          (far - laser.near_distance_correction_y_m) / (kFarCalibration - kNearCalibrationY);
      table.near_slope_x[c] = static_cast<float>(slope_x);
      table.near_slope_y[c] = static_cast<float>(slope_y);
      table.near_x[c] =
          static_cast<float>(laser.near_distance_correction_x_m - far - slope_x * kNearCalibrationX);
      table.near_y[c] =
          static_cast<float>(laser.near_distance_correction_y_m - far - slope_y * kNearCalibrationY);
      table.far_raw[c] = static_cast<std::int32_t>((kFarCalibration - far) / sensor.distance_resolution_m);
      near_corrected_ = true;
    }
    const double focus = 1.0 - laser.focal_distance_m / kFocalRange;
    table.focal_offset[c] = static_cast<float>(256.0 * focus * focus);
    table.focal_slope[c] = static_cast<float>(laser.focal_slope);
    table.min_intensity[c] = laser.min_intensity;
    table.max_intensity[c] = laser.max_intensity;
    near_corrected_ = near_corrected_ || laser.focal_slope != 0.0;
    const double low = (min_range_m - far) / sensor.distance_resolution_m;
    const double high = (max_range_m - far) / sensor.distance_resolution_m;
    table.min_raw[c] = static_cast<std::int32_t>(std::clamp(std::ceil(low - kRounding), 1.0, 65536.0));
    table.max_raw[c] = static_cast<std::int32_t>(std::clamp(std::floor(high + kRounding), 0.0, 65535.0));
    if (!laser.enabled) table.max_raw[c] = 0;
    table.time_ns[c] = entry.time_offset_ns;
    interpolated_ = interpolated_ || entry.azimuth_fraction != 0.0F;
  }
}

void FiringDecoder::fill_times() {
  bool first = true;
  for (const BlockTable& table : tables_) {
    if (table.content == BlockContent::kPadding) continue;
    for (const std::int32_t time : table.time_ns) {
      first_firing_ns_ = first ? time : std::min(first_firing_ns_, time);
      last_firing_ns_ = first ? time : std::max(last_firing_ns_, time);
      first = false;
    }
  }
}

void FiringDecoder::set_rate(float rate) {
  if (!interpolated_ || rate == rate_) return;
  rate_ = rate;
  const float step = rate * static_cast<float>(kRadiansPerAzimuth);
  for (std::size_t b = 0; b < tables_.size(); ++b) {
    BlockTable& table = tables_[b];
    if (table.partner < b) {
      // The same lasers at the same time.
      table.sin_shift = tables_[table.partner].sin_shift;
      table.cos_shift = tables_[table.partner].cos_shift;
      continue;
    }
    for (std::size_t c = 0; c < kEntriesPerBlock; ++c) {
      // Angles are at most one degree: the series is exact to single precision.
      const float angle = step * table.fraction[c];
      const float squared = angle * angle;
      const float sin = angle * (1.0F - squared / 6.0F);
      const float cos = 1.0F - squared / 2.0F + squared * squared / 24.0F;
      table.sin_shift[c] = sin * table.cos_correction[c] + cos * table.sin_correction[c];
      table.cos_shift[c] = cos * table.cos_correction[c] - sin * table.sin_correction[c];
    }
  }
}

/// Selects returns; of two equal returns the last one is kept. Without branches, so that the loop vectorises.
void FiringDecoder::choose_returns(const BlockTable& table, const Words& words, const Words& others,
                                   Mask& keep) const {
  if (returns_ == ReturnChoice::kAll) {
    // Of the block without the last returns: those that differ.
    for (std::size_t c = 0; c < kEntriesPerBlock; ++c)
      keep[c] = static_cast<std::int32_t>(distance_of(words[c]) != distance_of(others[c]));
    return;
  }
  const auto is_last = static_cast<std::int32_t>(table.content == BlockContent::kLast);
  const auto want_last = static_cast<std::int32_t>(returns_ == ReturnChoice::kLast);
  const auto want_strongest = static_cast<std::int32_t>(returns_ == ReturnChoice::kStrongest);
  for (std::size_t c = 0; c < kEntriesPerBlock; ++c) {
    const auto distance = static_cast<std::int32_t>(distance_of(words[c]));
    const auto other_distance = static_cast<std::int32_t>(distance_of(others[c]));
    const auto alone = static_cast<std::int32_t>(other_distance == 0);
    // A missing return is weaker than any; of two equally strong returns the one that is not the last is
    // chosen.
    const std::int32_t strength = 2 * static_cast<std::int32_t>(intensity_of(words[c])) + 1 - is_last;
    const std::int32_t other_strength = 2 * static_cast<std::int32_t>(intensity_of(others[c])) + is_last;
    const auto stronger = static_cast<std::int32_t>(strength > other_strength);
    const auto there = static_cast<std::int32_t>(distance != 0);
    keep[c] = (want_last & (is_last | alone)) | (want_strongest & (alone | (there & stronger)));
  }
}

void FiringDecoder::place(const BlockTable& table, SinCos azimuth, const Words& words, Points& points) const {
  for (std::size_t c = 0; c < kEntriesPerBlock; ++c) {
    const auto raw = static_cast<float>(static_cast<std::int32_t>(distance_of(words[c])));
    const float distance = raw * resolution_ + table.distance_correction[c];
    const float range = distance * table.cos_elevation[c] + table.range_offset[c];
    const float sin = azimuth.sin * table.cos_shift[c] + azimuth.cos * table.sin_shift[c];
    const float cos = azimuth.cos * table.cos_shift[c] - azimuth.sin * table.sin_shift[c];
    points.x[c] = range * cos + table.side_offset[c] * sin;
    points.y[c] = table.side_offset[c] * cos - range * sin;
    points.z[c] = distance * table.sin_elevation[c] + table.height_offset[c];
    points.intensity[c] = static_cast<float>(static_cast<std::int32_t>(intensity_of(words[c])));
  }
}

/// Near-range correction of the HDL-64E manual: below 25 m the distance correction depends on |x| and |y| of
/// the Velodyne frame, here -y and x.
void FiringDecoder::correct_near_range(const BlockTable& table, SinCos azimuth, const Words& words,
                                       Points& points) const {
  for (std::size_t c = 0; c < kEntriesPerBlock; ++c) {
    const auto raw = static_cast<std::int32_t>(distance_of(words[c]));
    // A factor, because a floating-point condition would prevent vectorisation.
    const auto is_near = static_cast<float>(static_cast<std::int32_t>(raw < table.far_raw[c]));
    const float sin = azimuth.sin * table.cos_shift[c] + azimuth.cos * table.sin_shift[c];
    const float cos = azimuth.cos * table.cos_shift[c] - azimuth.sin * table.sin_shift[c];
    const float near_x = is_near * (table.near_slope_x[c] * std::abs(points.y[c]) + table.near_x[c]);
    const float near_y = is_near * (table.near_slope_y[c] * std::abs(points.x[c]) + table.near_y[c]);
    points.x[c] += near_y * table.cos_elevation[c] * cos;
    points.y[c] -= near_x * table.cos_elevation[c] * sin;
    points.z[c] += 0.5F * (near_x + near_y) * table.sin_elevation[c];
  }
}

/// Intensity correction of the HDL-64E manual: removes the dependence on the distance from the focus.
void FiringDecoder::correct_intensity(const BlockTable& table, const Words& words, Points& points) const {
  for (std::size_t c = 0; c < kEntriesPerBlock; ++c) {
    const auto raw = static_cast<float>(static_cast<std::int32_t>(distance_of(words[c])));
    const float nearness = 1.0F - raw * (1.0F / 65535.0F);
    const float blur = std::abs(table.focal_offset[c] - 256.0F * nearness * nearness);
    const float corrected = points.intensity[c] + table.focal_slope[c] * blur;
    const float at_least = corrected < table.min_intensity[c] ? table.min_intensity[c] : corrected;
    points.intensity[c] = at_least > table.max_intensity[c] ? table.max_intensity[c] : at_least;
  }
}

/// Appends the kept points. Every point is written and only the kept ones advance the end, so that there is
/// no branch to mispredict; the values are interleaved first, because that vectorises.
core::Point* FiringDecoder::append(const BlockTable& table, const Points& decoded, const Mask& keep,
                                   std::int32_t time_ns, core::Point* out) {
  static_assert(sizeof(core::Point) == 24 && offsetof(core::Point, time_offset_ns) == 16 &&
                offsetof(core::Point, ring) == 20 && offsetof(core::Point, return_kind) == 22 &&
                std::endian::native == std::endian::little);
  alignas(16) std::array<float, 4 * kEntriesPerBlock> values;
  alignas(16) std::array<std::int32_t, 2 * kEntriesPerBlock> tails;
  for (std::size_t c = 0; c < kEntriesPerBlock; ++c) {
    values[4 * c] = decoded.x[c];
    values[4 * c + 1] = decoded.y[c];
    values[4 * c + 2] = decoded.z[c];
    values[4 * c + 3] = decoded.intensity[c];
  }
  const std::int32_t return_kind = static_cast<std::int32_t>(table.content) << 16;
  for (std::size_t c = 0; c < kEntriesPerBlock; ++c) {
    tails[2 * c] = time_ns + table.time_ns[c];
    tails[2 * c + 1] = table.ring[c] | return_kind;
  }
  for (std::size_t c = 0; c < kEntriesPerBlock; ++c) {
    auto* const bytes = reinterpret_cast<unsigned char*>(out);
    std::memcpy(bytes, &values[4 * c], 16);
    std::memcpy(bytes + 16, &tails[2 * c], 8);
    out += keep[c];
  }
  return out;
}

FiringDecoder::Counts FiringDecoder::decode_step(std::span<const std::uint8_t> payload, std::size_t step,
                                                 std::int32_t time_ns, std::span<core::Point> points) const {
  const std::uint8_t* const blocks = payload.data() + step * blocks_per_step_ * kBlockSize;
  const SinCos azimuth = (*azimuths_)[load_le16(blocks + kAzimuthOffset)];
  std::int32_t returns = 0;
  std::array<bool, kBlocksPerPacket> copies{};
  core::Point* out = points.data();
  for (std::size_t b = 0; b < blocks_per_step_; ++b) {
    const BlockTable& table = tables_[b];
    if (table.content == BlockContent::kPadding || table.content == BlockContent::kConfidence) continue;
    const std::uint8_t* const block = blocks + b * kBlockSize;
    const std::uint8_t* const other = blocks + table.partner * kBlockSize;
    const bool is_one_of_two = table.partner != b;
    // Most surfaces give one return, which both blocks hold: one of them is skipped as a whole.
    if (is_one_of_two) {
      copies[b] = table.partner < b ? copies[table.partner]
                                    : std::memcmp(block + kEntriesOffset, other + kEntriesOffset,
                                                  kEntriesPerBlock * kEntrySize) == 0;
    }
    const bool is_copy = copies[b];
    const bool is_last = table.content == BlockContent::kLast;
    if (is_copy && is_last == (returns_ == ReturnChoice::kStrongest)) continue;
    const Words words = load_entries(block);
    Mask keep;
    keep.fill(1);
    const bool is_chosen = is_copy || (is_last && returns_ == ReturnChoice::kAll);
    if (is_one_of_two && !is_chosen) choose_returns(table, words, load_entries(other), keep);
    std::int32_t kept = 0;
    for (std::size_t c = 0; c < kEntriesPerBlock; ++c) {
      const auto raw = static_cast<std::int32_t>(distance_of(words[c]));
      returns += static_cast<std::int32_t>(raw != 0) & keep[c];
      keep[c] &= static_cast<std::int32_t>(raw >= table.min_raw[c]) &
                 static_cast<std::int32_t>(raw <= table.max_raw[c]);
      kept |= keep[c];
    }
    if (kept == 0) continue;
    Points decoded;
    place(table, azimuth, words, decoded);
    if (near_corrected_) {
      correct_near_range(table, azimuth, words, decoded);
      correct_intensity(table, words, decoded);
    }
    out = append(table, decoded, keep, time_ns, out);
  }
  Counts counts;
  counts.points = static_cast<std::size_t>(out - points.data());
  counts.out_of_range = static_cast<std::size_t>(returns) - counts.points;
  return counts;
}

}  // namespace nilio::drivers
