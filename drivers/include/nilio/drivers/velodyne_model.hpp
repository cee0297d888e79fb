#pragma once

#include "nilio/core/result.hpp"

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace nilio::drivers {

inline constexpr std::size_t kDataPacketSize = 1206;
inline constexpr std::size_t kPositionPacketSize = 512;
inline constexpr std::size_t kBlocksPerPacket = 12;
inline constexpr std::size_t kEntriesPerBlock = 32;
/// Azimuth is counted in hundredths of a degree.
inline constexpr int kAzimuthModulus = 36000;

enum class VelodyneModel { kVlp16, kHdl64eS2 };

/// Geometry of one laser (angles in rad, lengths in m), as the manufacturer's calibration files have it.
struct LaserCalibration {
  double elevation_rad = 0.0;
  /// Subtracted from the block's azimuth.
  double azimuth_correction_rad = 0.0;
  double distance_correction_m = 0.0;
  double vertical_offset_m = 0.0;
  double horizontal_offset_m = 0.0;
  /// Rank by elevation, 0 = lowest.
  std::uint16_t ring = 0;
};

/// Where an entry of a block comes from and when it was fired.
struct PacketEntry {
  std::uint16_t laser = 0;
  /// Relative to the packet's time stamp (its first firing).
  std::int32_t time_offset_ns = 0;
  /// Azimuth advance since the block's azimuth, as a share of the advance from this azimuth step to the next;
  /// 0 where the azimuth is not interpolated.
  float azimuth_fraction = 0.0F;
};

/// Everything the decoder and the encoder know about a sensor: data, no code.
struct VelodyneSensor {
  VelodyneModel model = VelodyneModel::kVlp16;
  std::string name;
  double distance_resolution_m = 0.002;
  /// Indexed by laser id.
  std::vector<LaserCalibration> lasers;
  /// The vertical offset is measured across the beam, so that it shifts the horizontal range too (HDL-64E);
  /// otherwise it is along the sensor's axis.
  bool vertical_offset_across_beam = false;
  std::array<std::array<PacketEntry, kEntriesPerBlock>, kBlocksPerPacket> entries{};
  /// Block flags as little-endian numbers (0xEEFF, 0xDDFF) expected at each block.
  std::array<std::uint16_t, kBlocksPerPacket> block_flags{};
  /// Blocks that share one azimuth step: 1 (VLP-16) or 2 (HDL-64E).
  std::uint8_t blocks_per_azimuth = 1;
  /// Time from one azimuth step to the next, and from one packet to the next (nominal).
  std::int64_t azimuth_period_ns = 0;
  std::int64_t packet_period_ns = 0;
  /// Factory bytes 1204 and 1205 for an encoder; HDL-64E has a status stream there instead.
  std::uint8_t return_mode_byte = 0x37;
  std::uint8_t product_byte = 0;
  /// Median vertical angle between neighbouring beams.
  float beam_spacing_rad = 0.0F;
};

/// Built-in sensor with its factory geometry (VLP-16 manual 63-9243). HDL-64E S2 has no factory geometry
/// common to all units: it gets that of KITTI's scanner, recovered from KITTI's clouds; its distance
/// corrections are known modulo the 2 mm resolution only, which is what re-encoding KITTI needs. Real units
/// need with_calibration_file().
VelodyneSensor make_velodyne_sensor(VelodyneModel model);

/// "VLP-16", "HDL-64E-S2", as used in configuration and messages; parsing ignores case, '-' and '_'.
std::string_view velodyne_model_name(VelodyneModel model);
std::optional<VelodyneModel> parse_velodyne_model(std::string_view name);

/// Replaces the per-laser geometry by a calibration file in the YAML form of the ROS Velodyne driver
/// (radians, metres). The file's near-range, focus and intensity values are accepted and not used; its
/// distance_resolution neither, since packets of a model have one resolution whatever a file says. Errors
/// name file, line and key.
core::Result<VelodyneSensor> with_calibration_file(VelodyneSensor sensor, const std::string& path);

}  // namespace nilio::drivers
