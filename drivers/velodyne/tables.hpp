#pragma once

#include "nilio/drivers/velodyne/model.hpp"

#include "drivers/velodyne/lasers.hpp"

#include <array>
#include <cstdint>
#include <span>
#include <string_view>

namespace nilio::drivers {

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
  /// From one firing of all lasers to the next, by return mode.
  std::array<std::int64_t, 3> firing_period_ns{};
  /// Time of a laser inside its firing.
  std::int64_t (*firing_offset_ns)(std::size_t laser, ReturnMode mode) = nullptr;
  /// The first laser's time relative to the packet's stamp.
  std::int64_t first_firing_ns = 0;
  bool azimuth_interpolated = false;
  bool measured_period = false;
  bool has_clock = true;
  /// Block flags of the banks of 32 lasers; one for up to 32 lasers.
  std::span<const std::uint16_t> flags;
  /// Firings that share the azimuth of one block: 2 for 16 lasers, else 1.
  std::size_t firings_per_block = 1;
  /// Return modes the model has, kSingle first.
  std::span<const ReturnMode> modes;
  /// Whether both returns of a bank follow one another (VLP, VLS), or all banks of the strongest return come
  /// before those of the last (HDL-64E).
  bool returns_by_bank = true;
  std::uint8_t product_byte = 0;
};

ModelTable model_table(VelodyneModel model);

/// Ranks the lasers by elevation and takes their spacing, after the elevations were set.
void finish_geometry(VelodyneSensor& sensor);

}  // namespace nilio::drivers
