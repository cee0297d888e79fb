#include "nilio/drivers/velodyne_model.hpp"

#include "velodyne_tables.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <numbers>
#include <numeric>
#include <span>

namespace nilio::drivers {
namespace {

constexpr double kRadiansPerDegree = std::numbers::pi / 180.0;

std::string normalised(std::string_view name) {
  std::string result;
  for (const char c : name) {
    if (c == '-' || c == '_') continue;
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
    laser.vertical_offset_m = row.vertical_offset_m + table.beam_crossing_m * std::tan(-laser.elevation_rad);
    laser.horizontal_offset_m = row.horizontal_offset_m;
    lasers.push_back(laser);
  }
  return lasers;
}

/// The entries of a packet in order are the firings of all lasers in order, again and again: this holds for
/// every single-return model, so one rule fills every table.
void fill_entries(const ModelTable& table, VelodyneSensor& sensor) {
  const std::size_t lasers = table.lasers.size();
  const std::size_t entries_per_azimuth = kEntriesPerBlock * table.blocks_per_azimuth;
  const auto time_of = [&](std::size_t entry) {
    return table.firing_period_ns * static_cast<std::int64_t>(entry / lasers) +
           table.firing_offset_ns(entry % lasers);
  };
  for (std::size_t entry = 0; entry < kBlocksPerPacket * kEntriesPerBlock; ++entry) {
    PacketEntry& out = sensor.entries[entry / kEntriesPerBlock][entry % kEntriesPerBlock];
    out.laser = static_cast<std::uint16_t>(entry % lasers);
    out.time_offset_ns = static_cast<std::int32_t>(time_of(entry));
    if (table.azimuth_interpolated) {
      const std::int64_t azimuth_time = time_of(entry - entry % entries_per_azimuth);
      out.azimuth_fraction = static_cast<float>(static_cast<double>(time_of(entry) - azimuth_time) /
                                                static_cast<double>(table.azimuth_period_ns));
    }
  }
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

VelodyneSensor make_velodyne_sensor(VelodyneModel model) {
  const ModelTable& table = model_table(model);
  VelodyneSensor sensor;
  sensor.model = model;
  sensor.name = table.name;
  sensor.distance_resolution_m = table.distance_resolution_m;
  sensor.vertical_offset_across_beam = table.vertical_offset_across_beam;
  sensor.lasers = make_lasers(table);
  sensor.blocks_per_azimuth = table.blocks_per_azimuth;
  sensor.azimuth_period_ns = table.azimuth_period_ns;
  sensor.packet_period_ns =
      table.azimuth_period_ns * static_cast<std::int64_t>(kBlocksPerPacket / table.blocks_per_azimuth);
  sensor.return_mode_byte = table.return_mode_byte;
  sensor.product_byte = table.product_byte;
  for (std::size_t block = 0; block < kBlocksPerPacket; ++block) {
    sensor.block_flags[block] = table.flags[block % table.flags.size()];
  }
  fill_entries(table, sensor);
  finish_geometry(sensor);
  return sensor;
}

std::string_view velodyne_model_name(VelodyneModel model) { return model_table(model).name; }

std::optional<VelodyneModel> parse_velodyne_model(std::string_view name) {
  const std::string wanted = normalised(name);
  for (const VelodyneModel model : {VelodyneModel::kVlp16, VelodyneModel::kHdl64eS2}) {
    if (normalised(velodyne_model_name(model)) == wanted) return model;
  }
  return std::nullopt;
}

}  // namespace nilio::drivers
