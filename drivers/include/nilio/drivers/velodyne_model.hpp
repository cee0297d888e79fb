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

/// One laser (angles in rad, lengths in m), as the manufacturer's calibration files have it.
struct LaserCalibration {
  double elevation_rad = 0.0;
  /// Subtracted from the block's azimuth.
  double azimuth_correction_rad = 0.0;
  /// Added to the measured distance; found at 25.04 m where the near corrections are known too.
  double distance_correction_m = 0.0;
  double vertical_offset_m = 0.0;
  double horizontal_offset_m = 0.0;
  /// Rank by elevation, 0 = lowest.
  std::uint16_t ring = 0;
  /// Distance corrections near the sensor, found at 2.40 m along x and at 1.93 m along y; between there and
  /// 25.04 m the correction is linear ("two-point correction"). Both 0 = not known, then the far one holds
  /// everywhere.
  double near_distance_correction_x_m = 0.0;
  double near_distance_correction_y_m = 0.0;
  /// Where the receiver is in focus and how strongly the intensity falls off away from there, per the
  /// manual's intensity formula (scale 131 m). Both 0 = not known, then intensities are taken as measured.
  double focal_distance_m = 0.0;
  double focal_slope = 0.0;
  /// Limits of the corrected intensity.
  std::uint8_t min_intensity = 0;
  std::uint8_t max_intensity = 255;
  /// False where the calibration file says that the laser is switched off.
  bool enabled = true;

  friend bool operator==(const LaserCalibration&, const LaserCalibration&) = default;
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

/// Replaces the lasers by those of a calibration file: the YAML form of the ROS Velodyne driver (radians,
/// metres) or Velodyne's own db.xml (degrees, centimetres), told apart by content. A YAML file's
/// distance_resolution is not used, since packets of a model have one resolution whatever a file says; a
/// db.xml with another resolution than the model's is refused. Values out of their plausible range are
/// refused with a word on units. Errors name file, line, laser and key. Lasers that the file switches off
/// keep their geometry and have `enabled` false (see disabled_lasers()).
core::Result<VelodyneSensor> with_calibration_file(VelodyneSensor sensor, const std::string& path);

}  // namespace nilio::drivers
