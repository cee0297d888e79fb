#pragma once

#include "nilio/core/result.hpp"
#include "nilio/drivers/velodyne/model.hpp"

#include <array>
#include <numbers>
#include <optional>
#include <string>
#include <string_view>

namespace nilio::drivers {

enum class Quantity { kAngle, kLength, kRatio };

/// One number of a laser: its key in either kind of file, its member, and its plausible range in SI units.
struct CalibrationField {
  const char* yaml_key;
  const char* xml_key;
  double LaserCalibration::*target;
  Quantity quantity;
  double lowest;
  double highest;
  bool required_in_yaml;
  bool required_in_xml;
};

inline constexpr double kQuarterTurn = std::numbers::pi / 2.0;
inline constexpr double kTurn = 2.0 * std::numbers::pi;

inline constexpr std::array<CalibrationField, 9> kCalibrationFields{{
    {"rot_correction", "rotCorrection_", &LaserCalibration::azimuth_correction_rad, Quantity::kAngle, -kTurn,
     kTurn, true, true},
    {"vert_correction", "vertCorrection_", &LaserCalibration::elevation_rad, Quantity::kAngle, -kQuarterTurn,
     kQuarterTurn, true, true},
    {"dist_correction", "distCorrection_", &LaserCalibration::distance_correction_m, Quantity::kLength, -10.0,
     10.0, false, true},
    {"dist_correction_x", "distCorrectionX_", &LaserCalibration::near_distance_correction_x_m,
     Quantity::kLength, -10.0, 10.0, false, false},
    {"dist_correction_y", "distCorrectionY_", &LaserCalibration::near_distance_correction_y_m,
     Quantity::kLength, -10.0, 10.0, false, false},
    {"vert_offset_correction", "vertOffsetCorrection_", &LaserCalibration::vertical_offset_m,
     Quantity::kLength, -1.0, 1.0, false, true},
    {"horiz_offset_correction", "horizOffsetCorrection_", &LaserCalibration::horizontal_offset_m,
     Quantity::kLength, -1.0, 1.0, false, true},
    // Factory values reach 24 m; larger ones are centimetres, as in some old YAML files.
    {"focal_distance", "focalDistance_", &LaserCalibration::focal_distance_m, Quantity::kLength, 0.0, 25.0,
     false, false},
    {"focal_slope", "focalSlope_", &LaserCalibration::focal_slope, Quantity::kRatio, 0.0, 20.0, false, false},
}};

/// Units of a kind of file: factors to SI, and names for messages.
struct FileUnits {
  double angle = 1.0;
  double length = 1.0;
  const char* angle_name = "";
  const char* length_name = "";
};

inline constexpr FileUnits kYamlUnits{1.0, 1.0, "radians", "metres"};
inline constexpr FileUnits kXmlUnits{std::numbers::pi / 180.0, 0.01, "degrees", "centimetres"};

/// Converts `value` to SI units; the error is "is 152, expected ... metres".
core::Result<double> to_si(const CalibrationField& field, double value, const FileUnits& units);

/// Describes a contradiction between the values of a laser; nothing if there is none.
std::optional<std::string> laser_fault(const LaserCalibration& laser);

/// An intensity limit; nothing unless it is a whole number of 0 to 255.
std::optional<std::uint8_t> to_intensity(double value);

/// Shortest text that parses to the same number.
std::string format_number(double value);

core::Result<VelodyneSensor> read_yaml_calibration(VelodyneSensor sensor, const std::string& text,
                                                   const std::string& path);
core::Result<VelodyneSensor> read_xml_calibration(VelodyneSensor sensor, const std::string& text,
                                                  const std::string& path);

}  // namespace nilio::drivers
