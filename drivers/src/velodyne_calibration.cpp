#include "nilio/drivers/nearest_name.hpp"
#include "nilio/drivers/velodyne_model.hpp"

#include "velodyne_tables.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <vector>

#include <yaml-cpp/yaml.h>

namespace nilio::drivers {
namespace {

using core::Error;

/// One number of a laser: its key, where it goes, and the magnitude beyond which it cannot be meant.
struct CalibrationKey {
  const char* name;
  double LaserCalibration::*target;
  double limit;
  bool required;
  const char* limit_hint;
};

constexpr std::array<CalibrationKey, 5> kKeys{{
    {"vert_correction", &LaserCalibration::elevation_rad, 1.5708, true, "angles are in radians"},
    {"rot_correction", &LaserCalibration::azimuth_correction_rad, 6.2832, true, "angles are in radians"},
    {"dist_correction", &LaserCalibration::distance_correction_m, 10.0, false, "lengths are in metres"},
    {"vert_offset_correction", &LaserCalibration::vertical_offset_m, 1.0, false, "lengths are in metres"},
    {"horiz_offset_correction", &LaserCalibration::horizontal_offset_m, 1.0, false, "lengths are in metres"},
}};

/// Keys such files have that geometry does not need.
constexpr std::array<const char*, 9> kUnusedKeys{
    "dist_correction_x", "dist_correction_y", "focal_distance", "focal_slope",
    "close_slope",       "min_intensity",     "max_intensity",  "two_pt_correction_available",
    "laser_id",
};

std::string place(const std::string& path, const YAML::Mark& mark) {
  return mark.is_null() ? path : path + ":" + std::to_string(mark.line + 1);
}

std::vector<std::string> known_keys() {
  std::vector<std::string> names(kUnusedKeys.begin(), kUnusedKeys.end());
  for (const CalibrationKey& key : kKeys) names.emplace_back(key.name);
  return names;
}

core::Result<double> read_number(const YAML::Node& node, const std::string& path, const CalibrationKey& key) {
  double value = 0.0;
  if (!node.IsScalar() || !YAML::convert<double>::decode(node, value) || !std::isfinite(value)) {
    return Error{place(path, node.Mark()) + ": " + key.name + " is not a number"};
  }
  if (std::abs(value) > key.limit) {
    return Error{place(path, node.Mark()) + ": " + key.name + " is " + node.Scalar() + ", expected at most " +
                 std::to_string(key.limit) + " either way; " + key.limit_hint};
  }
  return value;
}

core::Result<LaserCalibration> read_laser(const YAML::Node& node, const std::string& path) {
  LaserCalibration laser;
  for (const CalibrationKey& key : kKeys) {
    const YAML::Node value = node[key.name];
    if (!value) {
      if (key.required) return Error{place(path, node.Mark()) + ": this laser has no " + key.name};
      continue;
    }
    const core::Result<double> number = read_number(value, path, key);
    if (!number) return number.error();
    laser.*key.target = *number;
  }
  const std::vector<std::string> known = known_keys();
  for (const auto& pair : node) {
    const std::string name = pair.first.IsScalar() ? pair.first.Scalar() : "?";
    if (std::find(known.begin(), known.end(), name) == known.end()) {
      return Error{place(path, pair.first.Mark()) + ": unknown key '" + name + "'" +
                   nearest_name_hint(name, known)};
    }
  }
  return laser;
}

/// Fills `sensor.lasers`; returns the number of lasers or what is wrong.
core::Result<std::size_t> read_lasers(const YAML::Node& list, const std::string& path,
                                      VelodyneSensor& sensor) {
  const std::size_t expected = sensor.lasers.size();
  std::vector<bool> seen(expected, false);
  for (const YAML::Node& node : list) {
    if (!node.IsMap()) return Error{place(path, node.Mark()) + ": expected a laser, as '{laser_id: 0, ...}'"};
    const YAML::Node id_node = node["laser_id"];
    std::size_t id = 0;
    if (!id_node || !id_node.IsScalar() || !YAML::convert<std::size_t>::decode(id_node, id) ||
        id >= expected) {
      return Error{place(path, id_node ? id_node.Mark() : node.Mark()) +
                   ": laser_id is missing or not one of 0.." + std::to_string(expected - 1) + " of a " +
                   sensor.name};
    }
    if (seen[id])
      return Error{place(path, id_node.Mark()) + ": laser_id " + std::to_string(id) + " is there twice"};
    seen[id] = true;
    core::Result<LaserCalibration> laser = read_laser(node, path);
    if (!laser) return laser.error();
    sensor.lasers[id] = *laser;
  }
  return list.size();
}

core::Result<VelodyneSensor> read_calibration(VelodyneSensor sensor, const std::string& path) {
  const YAML::Node root = YAML::LoadFile(path);
  const YAML::Node list = root.IsMap() ? root["lasers"] : YAML::Node(YAML::NodeType::Undefined);
  if (!list || !list.IsSequence()) {
    return Error{path + ": no list 'lasers'; expected a calibration as the ROS Velodyne driver has them"};
  }
  if (list.size() != sensor.lasers.size()) {
    return Error{place(path, list.Mark()) + ": " + std::to_string(list.size()) + " lasers, but a " +
                 sensor.name + " has " + std::to_string(sensor.lasers.size()) +
                 "; take the file of this model"};
  }
  const core::Result<std::size_t> count = read_lasers(list, path, sensor);
  if (!count) return count.error();
  finish_geometry(sensor);
  return sensor;
}

}  // namespace

core::Result<VelodyneSensor> with_calibration_file(VelodyneSensor sensor, const std::string& path) {
  try {
    return read_calibration(std::move(sensor), path);
  } catch (const YAML::BadFile&) {
    return Error{path + ": cannot be read; check that the file exists and its permissions"};
  } catch (const YAML::Exception& error) {
    return Error{place(path, error.mark) + ": " + error.msg};
  }
}

}  // namespace nilio::drivers
