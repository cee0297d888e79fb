#pragma once

#include "nilio/core/result.hpp"

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

namespace nilio::drivers {

inline constexpr std::size_t kDataPacketSize = 1206;
inline constexpr std::size_t kPositionPacketSize = 512;
inline constexpr std::size_t kBlocksPerPacket = 12;
inline constexpr std::size_t kEntriesPerBlock = 32;
/// Azimuth is counted in hundredths of a degree.
inline constexpr int kAzimuthModulus = 36000;

enum class VelodyneModel : std::uint8_t {
  kVlp16,
  kPuckLite,
  kPuckHiRes,
  kHdl32e,
  kVlp32a,
  kVlp32b,
  kVlp32c,
  kVls128,
  kHdl64eS1,
  kHdl64eS2,
  kHdl64eS21,
  kHdl64eS3,
};
inline constexpr std::size_t kVelodyneModelCount = 12;

/// Returns per firing: one (the strongest or the last, by the sensor's setting), two, or two with a
/// confidence word.
enum class ReturnMode : std::uint8_t { kSingle, kDual, kDualConfidence };

/// Content of a block of a packet.
enum class BlockContent : std::uint8_t {
  kSingle,      ///< the only return
  kLast,        ///< the last of two returns
  kStrongest,   ///< the strongest of two, or the second strongest when the strongest is the last
  kConfidence,  ///< quality words, no distances
  kPadding,     ///< unused
};

/// Calibration of one laser (angles in rad, lengths in m), as in the manufacturer's files.
struct LaserCalibration {
  double elevation_rad = 0.0;
  /// Subtracted from the block's azimuth.
  double azimuth_correction_rad = 0.0;
  /// Added to the measured distance; calibrated at 25.04 m where near corrections exist.
  double distance_correction_m = 0.0;
  double vertical_offset_m = 0.0;
  double horizontal_offset_m = 0.0;
  /// Rank by elevation, 0 = lowest.
  std::uint16_t ring = 0;
  /// Distance corrections near the sensor, calibrated at 2.40 m along x and at 1.93 m along y; the correction
  /// is linear from there to 25.04 m ("two-point correction"). Both 0 = unknown: the far correction holds
  /// everywhere.
  double near_distance_correction_x_m = 0.0;
  double near_distance_correction_y_m = 0.0;
  /// Focal distance of the receiver and slope of the intensity away from it, for the manual's intensity
  /// formula (scale 131 m). Both 0 = unknown: intensities are used as measured.
  double focal_distance_m = 0.0;
  double focal_slope = 0.0;
  /// Limits of the corrected intensity.
  std::uint8_t min_intensity = 0;
  std::uint8_t max_intensity = 255;
  /// False for a laser that the calibration file switches off.
  bool enabled = true;

  friend bool operator==(const LaserCalibration&, const LaserCalibration&) = default;
};

/// Laser and firing time of an entry of a block.
struct PacketEntry {
  std::uint16_t laser = 0;
  /// Relative to the packet's time stamp (its first firing).
  std::int32_t time_offset_ns = 0;
  /// Azimuth advance since the block's azimuth, as a share of the advance from this azimuth step to the next;
  /// 0 where the azimuth is not interpolated.
  float azimuth_fraction = 0.0F;
};

/// Layout of the firings in the packets of one return mode.
struct PacketLayout {
  ReturnMode mode = ReturnMode::kSingle;
  std::array<std::array<PacketEntry, kEntriesPerBlock>, kBlocksPerPacket> entries{};
  /// Block flags as little-endian numbers (0xEEFF, 0xDDFF, ...) expected at each block.
  std::array<std::uint16_t, kBlocksPerPacket> block_flags{};
  std::array<BlockContent, kBlocksPerPacket> contents{};
  /// Blocks that share one azimuth step, returns and padding included: a divisor of 12.
  std::uint8_t blocks_per_azimuth = 1;
  /// Shots of single lasers in one azimuth step.
  std::uint16_t firings_per_azimuth = kEntriesPerBlock;
  /// Time from one azimuth step to the next, and from one packet to the next (nominal).
  std::int64_t azimuth_period_ns = 0;
  std::int64_t packet_period_ns = 0;
  /// Byte 1204, for encoders.
  std::uint8_t return_mode_byte = 0x37;

  [[nodiscard]] std::size_t azimuth_steps() const { return kBlocksPerPacket / blocks_per_azimuth; }
  [[nodiscard]] std::uint32_t firings_per_packet() const {
    return static_cast<std::uint32_t>(firings_per_azimuth * azimuth_steps());
  }
};

/// Description of a sensor for decoder and encoder: data only.
struct VelodyneSensor {
  VelodyneModel model = VelodyneModel::kVlp16;
  std::string name;
  double distance_resolution_m = 0.002;
  /// Indexed by laser id.
  std::vector<LaserCalibration> lasers;
  /// The vertical offset is measured across the beam and also shifts the horizontal range (HDL-64E);
  /// otherwise along the sensor's axis.
  bool vertical_offset_across_beam = false;
  /// One layout for each return mode of the model; the first is kSingle.
  std::vector<PacketLayout> layouts;
  /// The firing period differs between firmwares and is measured from the packets' time stamps.
  bool measured_period = false;
  /// False for sensors whose packets carry no time (HDL-64E S1): host time is used.
  bool has_clock = true;
  /// Some firmware of the model synchronises its clock by PTP.
  bool has_ptp = false;
  /// Byte 1205, for encoders; 0 for the HDL-64E, which has a status stream in both bytes.
  std::uint8_t product_byte = 0;
  /// Median vertical angle between neighbouring beams.
  float beam_spacing_rad = 0.0F;

  /// Null when the model lacks this mode.
  [[nodiscard]] const PacketLayout* layout(ReturnMode mode) const;
  [[nodiscard]] const PacketLayout& single() const { return layouts.front(); }
};

/// Built-in sensor with its factory geometry (manuals 63-9243, 63-9325, 63-9483, HDL-32E). Every HDL-64E has
/// a geometry of its own; a real one needs with_calibration_file() or its status stream. S2 has the geometry
/// of KITTI's scanner, recovered from KITTI's clouds; its distance corrections are known modulo the 2 mm
/// resolution only, which suffices to re-encode KITTI. S1, S2.1 and S3 have that of one published unit.
VelodyneSensor make_velodyne_sensor(VelodyneModel model);

/// Interpolates the azimuth from firing to firing within a block, or keeps the block's azimuth. Default: on,
/// except for the HDL-64E, whose factory corrections were calibrated without interpolation.
void set_azimuth_interpolation(VelodyneSensor& sensor, bool on);

/// "VLP-16", "HDL-64E-S2", as used in configuration and messages; parsing ignores case, ' ', '-', '.' and
/// '_'.
std::string_view velodyne_model_name(VelodyneModel model);
std::optional<VelodyneModel> parse_velodyne_model(std::string_view name);
/// All models in the order of the enumeration.
std::array<VelodyneModel, kVelodyneModelCount> velodyne_models();
std::string_view return_mode_name(ReturnMode mode);

/// Replaces the lasers by those of a calibration file: the YAML form of the ROS Velodyne driver (radians,
/// metres) or Velodyne's own db.xml (degrees, centimetres), recognised by content. A YAML file's
/// distance_resolution is ignored, because the resolution of a model's packets is fixed; a db.xml with
/// another resolution than the model's is rejected. Values outside their plausible range are rejected; the
/// error names the expected units, file, line, laser and key. Lasers that the file switches off keep their
/// geometry and have `enabled` false (see disabled_lasers()).
core::Result<VelodyneSensor> with_calibration_file(VelodyneSensor sensor, const std::string& path);

/// Saves the lasers in the YAML form of the ROS Velodyne driver. with_calibration_file() reads exactly the
/// same numbers back. The file is replaced atomically; an error names it.
core::Result<std::monostate> write_calibration_yaml(const VelodyneSensor& sensor, const std::string& path);

/// Ids of the lasers that the calibration file switches off, ascending.
std::vector<std::uint16_t> disabled_lasers(const VelodyneSensor& sensor);

}  // namespace nilio::drivers
