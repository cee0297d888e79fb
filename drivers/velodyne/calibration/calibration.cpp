#include "drivers/velodyne/calibration/calibration_fields.hpp"

#include <array>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <fstream>

namespace nilio::drivers {
namespace {

using core::Error;

/// Size limit of a file; a calibration of 128 lasers has 50 kB.
constexpr std::size_t kLargestFile = std::size_t{4} << 20;

core::Result<std::string> read_text(const std::string& path) {
  const Error unreadable{path + ": cannot be read; check that the file exists and its permissions"};
  std::ifstream file(path, std::ios::binary);
  if (!file) return unreadable;
  std::string text;
  std::array<char, 16384> part{};
  do {
    file.read(part.data(), static_cast<std::streamsize>(part.size()));
    if (file.bad() || (file.fail() && !file.eof())) return unreadable;
    text.append(part.data(), static_cast<std::size_t>(file.gcount()));
  } while (!file.eof() && text.size() <= kLargestFile);
  if (text.size() > kLargestFile) {
    return Error{path + ": larger than 4 MB, hence no calibration; check that it is the right file"};
  }
  return text;
}

bool looks_like_xml(std::string_view text) {
  constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";
  if (text.starts_with(kByteOrderMark)) text.remove_prefix(kByteOrderMark.size());
  const std::size_t first = text.find_first_not_of(" \t\r\n");
  return first != std::string_view::npos && text[first] == '<';
}

const char* unit_name(Quantity quantity, const FileUnits& units) {
  switch (quantity) {
    case Quantity::kAngle:
      return units.angle_name;
    case Quantity::kLength:
      return units.length_name;
    case Quantity::kRatio:
      break;
  }
  return "(no unit)";
}

std::string laser_text(const LaserCalibration& laser, std::size_t id) {
  std::string text = "  - {laser_id: " + std::to_string(id);
  for (const CalibrationField& field : kCalibrationFields) {
    text += std::string(", ") + field.yaml_key + ": " + format_number(laser.*field.target);
  }
  text += ", min_intensity: " + std::to_string(laser.min_intensity) +
          ", max_intensity: " + std::to_string(laser.max_intensity);
  if (!laser.enabled) text += ", enabled: false";
  return text + "}\n";
}

std::string calibration_text(const VelodyneSensor& sensor) {
  std::string text = "# " + sensor.name + ", written by nilio. Angles in radians, lengths in metres.\n";
  text += "num_lasers: " + std::to_string(sensor.lasers.size()) + "\n";
  text += "distance_resolution: " + format_number(sensor.distance_resolution_m) + "\nlasers:\n";
  for (std::size_t id = 0; id < sensor.lasers.size(); ++id) text += laser_text(sensor.lasers[id], id);
  return text;
}

}  // namespace

std::string format_number(double value) {
  std::array<char, 32> text{};
  const auto result = std::to_chars(text.data(), text.data() + text.size(), value);
  return {text.data(), result.ptr};
}

core::Result<double> to_si(const CalibrationField& field, double value, const FileUnits& units) {
  const double scale = field.quantity == Quantity::kAngle    ? units.angle
                       : field.quantity == Quantity::kLength ? units.length
                                                             : 1.0;
  const double si = value * scale;
  if (std::isfinite(si) && si >= field.lowest && si <= field.highest) return si;
  const auto limit = [&](double bound) { return format_number(std::round(bound / scale * 1e4) / 1e4); };
  return Error{"is " + format_number(value) + ", expected " + limit(field.lowest) + " to " +
               limit(field.highest) + " " + unit_name(field.quantity, units)};
}

std::optional<std::string> laser_fault(const LaserCalibration& laser) {
  if (laser.min_intensity <= laser.max_intensity) return std::nullopt;
  return "its smallest intensity (" + std::to_string(laser.min_intensity) + ") is above its largest (" +
         std::to_string(laser.max_intensity) + ")";
}

std::optional<std::uint8_t> to_intensity(double value) {
  if (!(value >= 0.0 && value <= 255.0) || value != std::floor(value)) return std::nullopt;
  return static_cast<std::uint8_t>(value);
}

core::Result<VelodyneSensor> with_calibration_file(VelodyneSensor sensor, const std::string& path) {
  const core::Result<std::string> text = read_text(path);
  if (!text) return text.error();
  return looks_like_xml(*text) ? read_xml_calibration(std::move(sensor), *text, path)
                               : read_yaml_calibration(std::move(sensor), *text, path);
}

std::vector<std::uint16_t> disabled_lasers(const VelodyneSensor& sensor) {
  std::vector<std::uint16_t> ids;
  for (std::size_t id = 0; id < sensor.lasers.size(); ++id) {
    if (!sensor.lasers[id].enabled) ids.push_back(static_cast<std::uint16_t>(id));
  }
  return ids;
}

core::Result<std::monostate> write_calibration_yaml(const VelodyneSensor& sensor, const std::string& path) {
  const std::string unfinished = path + ".part";
  const auto failed = [&](const std::string& file) {
    const std::string reason = std::strerror(errno);
    std::remove(unfinished.c_str());
    return core::Error{file + ": cannot be written (" + reason +
                       "); check that the folder exists, its permissions and the space on its disk"};
  };
  errno = 0;
  std::ofstream file(unfinished, std::ios::binary | std::ios::trunc);
  if (!file) return failed(unfinished);
  file << calibration_text(sensor);
  file.close();
  if (!file) return failed(unfinished);
  if (std::rename(unfinished.c_str(), path.c_str()) != 0) return failed(path);
  return std::monostate{};
}

}  // namespace nilio::drivers
