#include "nilio/drivers/velodyne/calibration/calibration.hpp"

#include "drivers/velodyne/calibration/calibration_fields.hpp"

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fstream>

namespace nilio::drivers {
namespace {

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
