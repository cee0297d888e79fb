#pragma once

#include "nilio/drivers/velodyne_model.hpp"

#include <cstdint>
#include <span>
#include <string_view>

namespace nilio::drivers {

/// One laser of a model's table, in the units of the manuals.
struct LaserRow {
  double elevation_deg = 0.0;
  double azimuth_correction_deg = 0.0;
  double vertical_offset_m = 0.0;
  double horizontal_offset_m = 0.0;
  double distance_correction_m = 0.0;
};

/// A model as data; make_velodyne_sensor() derives everything else. Another model is another table.
struct ModelTable {
  std::string_view name;
  /// Indexed by laser id, which is also the order of the entries in a packet.
  std::span<const LaserRow> lasers;
  double distance_resolution_m = 0.002;
  /// Horizontal distance from the axis at which the beams cross; adds tan(-elevation) times this to the
  /// vertical offset.
  double beam_crossing_m = 0.0;
  bool vertical_offset_across_beam = false;
  /// From one firing of all lasers to the next.
  std::int64_t firing_period_ns = 0;
  /// Time of a laser inside its firing.
  std::int64_t (*firing_offset_ns)(std::size_t laser) = nullptr;
  std::uint8_t blocks_per_azimuth = 1;
  std::int64_t azimuth_period_ns = 0;
  bool azimuth_interpolated = false;
  /// Block flags, repeated through the packet.
  std::span<const std::uint16_t> flags;
  std::uint8_t return_mode_byte = 0;
  std::uint8_t product_byte = 0;
};

const ModelTable& model_table(VelodyneModel model);

/// Ranks the lasers by elevation and takes their spacing, after the elevations were set.
void finish_geometry(VelodyneSensor& sensor);

}  // namespace nilio::drivers
