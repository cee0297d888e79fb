#pragma once

#include "nilio/drivers/velodyne/model.hpp"

#include <array>
#include <cstdint>
#include <span>
#include <string_view>

namespace nilio::drivers {

/// One laser of a model's table, in the manuals' degrees and in metres.
struct LaserRow {
  double elevation_deg = 0.0;
  double azimuth_correction_deg = 0.0;
  double vertical_offset_m = 0.0;
  double horizontal_offset_m = 0.0;
  double distance_correction_m = 0.0;
  double near_distance_correction_x_m = 0.0;
  double near_distance_correction_y_m = 0.0;
  double focal_distance_m = 0.0;
  double focal_slope = 0.0;
  std::uint8_t min_intensity = 0;
  std::uint8_t max_intensity = 255;
};

/// Geometry of each model, indexed by laser id.
std::span<const LaserRow> vlp16_lasers();
std::span<const LaserRow> puck_hi_res_lasers();
std::span<const LaserRow> hdl32e_lasers();
std::span<const LaserRow> vlp32a_lasers();
std::span<const LaserRow> vlp32c_lasers();
std::span<const LaserRow> vls128_lasers();
std::span<const LaserRow> hdl64e_kitti_lasers();
std::span<const LaserRow> hdl64e_s21_lasers();
std::span<const LaserRow> hdl64e_s3_lasers();

/// Data of a model, from which make_velodyne_sensor() derives everything else.
struct ModelTable {
  std::string_view name;
  /// Indexed by laser id, which is also the order of the entries in a packet.
  std::span<const LaserRow> lasers;
  double distance_resolution_m = 0.002;
  /// Horizontal distance of the beams' crossing point from the axis; adds tan(-elevation) times this to the
  /// vertical offset.
  double beam_crossing_m = 0.0;
  bool vertical_offset_across_beam = false;
  /// Time between two firings of all lasers, by return mode.
  std::array<std::int64_t, 3> firing_period_ns{};
  /// Time of a laser inside its firing.
  std::int64_t (*firing_offset_ns)(std::size_t laser, ReturnMode mode) = nullptr;
  /// The first laser's time relative to the packet's stamp.
  std::int64_t first_firing_ns = 0;
  bool azimuth_interpolated = false;
  bool measured_period = false;
  bool has_clock = true;
  bool has_ptp = false;
  /// Block flags of the banks of 32 lasers; one for up to 32 lasers.
  std::span<const std::uint16_t> flags;
  /// Firings that share the azimuth of one block: 2 for 16 lasers, else 1.
  std::size_t firings_per_block = 1;
  /// Return modes the model has, kSingle first.
  std::span<const ReturnMode> modes;
  /// True if both returns of a bank are adjacent (VLP, VLS); false if all banks of the strongest return
  /// precede those of the last (HDL-64E).
  bool returns_by_bank = true;
  std::uint8_t product_byte = 0;
};

ModelTable model_table(VelodyneModel model);

/// Sets ranks and spacing of the lasers from their elevations.
void finish_geometry(VelodyneSensor& sensor);

}  // namespace nilio::drivers
