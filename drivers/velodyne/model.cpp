#include "nilio/drivers/velodyne/model.hpp"

#include "nilio/core/portable_math.hpp"
#include "nilio/core/units.hpp"

#include "drivers/velodyne/tables.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <numeric>
#include <span>

namespace nilio::drivers {
namespace {

std::string normalised(std::string_view name) {
  std::string result;
  for (const char c : name) {
    if (c == '-' || c == '_' || c == ' ' || c == '.') continue;
    result.push_back(static_cast<char>(std::tolower(static_cast<unsigned char>(c))));
  }
  return result;
}

std::vector<LaserCalibration> make_lasers(const ModelTable& table) {
  std::vector<LaserCalibration> lasers;
  lasers.reserve(table.lasers.size());
  for (const LaserRow& row : table.lasers) {
    LaserCalibration laser;
    laser.elevation_rad = row.elevation_deg * kRadiansPerDegree;
    laser.azimuth_correction_rad = row.azimuth_correction_deg * kRadiansPerDegree;
    laser.distance_correction_m = row.distance_correction_m;
    laser.vertical_offset_m =
        row.vertical_offset_m + table.beam_crossing_m * portable::tan(-laser.elevation_rad);
    laser.horizontal_offset_m = row.horizontal_offset_m;
    laser.near_distance_correction_x_m = row.near_distance_correction_x_m;
    laser.near_distance_correction_y_m = row.near_distance_correction_y_m;
    laser.focal_distance_m = row.focal_distance_m;
    laser.focal_slope = row.focal_slope;
    laser.min_intensity = row.min_intensity;
    laser.max_intensity = row.max_intensity;
    lasers.push_back(laser);
  }
  return lasers;
}

/// Bank of lasers and return of a block of an azimuth step.
struct BlockPlace {
  std::size_t bank = 0;
  BlockContent content = BlockContent::kSingle;
};

BlockPlace place_of(const ModelTable& table, ReturnMode mode, std::size_t block_in_step) {
  const std::size_t banks = table.flags.size();
  if (mode == ReturnMode::kSingle) return {block_in_step, BlockContent::kSingle};
  if (mode == ReturnMode::kDualConfidence) {
    constexpr std::array kContents{BlockContent::kLast, BlockContent::kStrongest, BlockContent::kConfidence};
    return {block_in_step / 3, kContents[block_in_step % 3]};
  }
  if (block_in_step >= 2 * banks) return {0, BlockContent::kPadding};
  if (!table.returns_by_bank)
    return {block_in_step % banks, block_in_step < banks ? BlockContent::kStrongest : BlockContent::kLast};
  return {block_in_step / 2, block_in_step % 2 == 0 ? BlockContent::kLast : BlockContent::kStrongest};
}

std::size_t blocks_per_azimuth(const ModelTable& table, ReturnMode mode) {
  const std::size_t banks = table.flags.size();
  if (mode == ReturnMode::kSingle) return banks;
  if (mode == ReturnMode::kDualConfidence) return 3 * banks;
  // Two returns of the VLS-128's four banks leave a third of the packet empty.
  return kBlocksPerPacket % (2 * banks) == 0 ? 2 * banks : kBlocksPerPacket;
}

std::uint8_t return_mode_byte(const ModelTable& table, ReturnMode mode) {
  if (table.product_byte == 0) return 0;
  return mode == ReturnMode::kSingle ? 0x37 : mode == ReturnMode::kDual ? 0x39 : 0x3B;
}

/// Firings are in order; a block holds one bank of 32 lasers, or two firings of 16.
PacketLayout make_layout(const ModelTable& table, ReturnMode mode) {
  const std::size_t lasers = table.lasers.size();
  const std::int64_t firing_period_ns = table.firing_period_ns[static_cast<std::size_t>(mode)];
  PacketLayout layout;
  layout.mode = mode;
  layout.blocks_per_azimuth = static_cast<std::uint8_t>(blocks_per_azimuth(table, mode));
  layout.firings_per_azimuth = static_cast<std::uint16_t>(lasers * table.firings_per_block);
  layout.azimuth_period_ns = firing_period_ns * static_cast<std::int64_t>(table.firings_per_block);
  layout.packet_period_ns = layout.azimuth_period_ns * static_cast<std::int64_t>(layout.azimuth_steps());
  layout.return_mode_byte = return_mode_byte(table, mode);
  for (std::size_t b = 0; b < kBlocksPerPacket; ++b) {
    const BlockPlace place = place_of(table, mode, b % layout.blocks_per_azimuth);
    layout.contents[b] = place.content;
    if (place.content == BlockContent::kPadding) continue;
    layout.block_flags[b] = table.flags[place.bank];
    const auto step = static_cast<std::int64_t>(b / layout.blocks_per_azimuth);
    for (std::size_t c = 0; c < kEntriesPerBlock; ++c) {
      PacketEntry& entry = layout.entries[b][c];
      entry.laser = static_cast<std::uint16_t>((place.bank * kEntriesPerBlock + c) % lasers);
      const std::int64_t since_azimuth_ns = firing_period_ns * static_cast<std::int64_t>(c / lasers) +
                                            table.firing_offset_ns(entry.laser, mode);
      entry.time_offset_ns = static_cast<std::int32_t>(table.first_firing_ns +
                                                       step * layout.azimuth_period_ns + since_azimuth_ns);
    }
  }
  return layout;
}

}  // namespace

void finish_geometry(VelodyneSensor& sensor) {
  std::vector<std::size_t> order(sensor.lasers.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return sensor.lasers[a].elevation_rad < sensor.lasers[b].elevation_rad;
  });
  std::vector<double> spacings;
  for (std::size_t rank = 0; rank < order.size(); ++rank) {
    sensor.lasers[order[rank]].ring = static_cast<std::uint16_t>(rank);
    if (rank > 0) {
      spacings.push_back(sensor.lasers[order[rank]].elevation_rad -
                         sensor.lasers[order[rank - 1]].elevation_rad);
    }
  }
  const auto middle = spacings.begin() + static_cast<std::ptrdiff_t>(spacings.size() / 2);
  std::nth_element(spacings.begin(), middle, spacings.end());
  sensor.beam_spacing_rad = static_cast<float>(*middle);
}

const PacketLayout* VelodyneSensor::layout(ReturnMode mode) const {
  const auto found = std::find_if(layouts.begin(), layouts.end(),
                                  [mode](const PacketLayout& layout) { return layout.mode == mode; });
  return found == layouts.end() ? nullptr : &*found;
}

VelodyneSensor make_velodyne_sensor(VelodyneModel model) {
  const ModelTable table = model_table(model);
  VelodyneSensor sensor;
  sensor.model = model;
  sensor.name = table.name;
  sensor.distance_resolution_m = table.distance_resolution_m;
  sensor.vertical_offset_across_beam = table.vertical_offset_across_beam;
  sensor.lasers = make_lasers(table);
  for (const ReturnMode mode : table.modes) sensor.layouts.push_back(make_layout(table, mode));
  set_azimuth_interpolation(sensor, table.azimuth_interpolated);
  sensor.measured_period = table.measured_period;
  sensor.has_clock = table.has_clock;
  sensor.has_ptp = table.has_ptp;
  sensor.product_byte = table.product_byte;
  finish_geometry(sensor);
  return sensor;
}

void set_azimuth_interpolation(VelodyneSensor& sensor, bool on) {
  for (PacketLayout& layout : sensor.layouts) {
    for (std::size_t b = 0; b < kBlocksPerPacket; ++b) {
      const std::size_t first_block = b - b % layout.blocks_per_azimuth;
      for (PacketEntry& entry : layout.entries[b]) {
        const std::int32_t since_azimuth_ns =
            entry.time_offset_ns - layout.entries[first_block][0].time_offset_ns;
        const bool moves = on && layout.contents[b] != BlockContent::kPadding;
        entry.azimuth_fraction = moves ? static_cast<float>(static_cast<double>(since_azimuth_ns) /
                                                            static_cast<double>(layout.azimuth_period_ns))
                                       : 0.0F;
      }
    }
  }
}

std::array<VelodyneModel, kVelodyneModelCount> velodyne_models() {
  std::array<VelodyneModel, kVelodyneModelCount> models{};
  for (std::size_t i = 0; i < models.size(); ++i) models[i] = static_cast<VelodyneModel>(i);
  return models;
}

std::string_view velodyne_model_name(VelodyneModel model) { return model_table(model).name; }

std::optional<VelodyneModel> parse_velodyne_model(std::string_view name) {
  const std::string wanted = normalised(name);
  for (const VelodyneModel model : velodyne_models()) {
    if (normalised(velodyne_model_name(model)) == wanted) return model;
  }
  // Product name of the VLS-128.
  if (wanted == "alphaprime") return VelodyneModel::kVls128;
  return std::nullopt;
}

std::string_view return_mode_name(ReturnMode mode) {
  constexpr std::array<std::string_view, 3> kNames{"single", "dual", "dual with confidence"};
  return kNames[static_cast<std::size_t>(mode)];
}

}  // namespace nilio::drivers
