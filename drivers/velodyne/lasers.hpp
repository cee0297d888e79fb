#pragma once

#include <cstdint>
#include <span>

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

}  // namespace nilio::drivers
