#include "nilio/drivers/common/nearest_name.hpp"

#include "drivers/velodyne/calibration/calibration_fields.hpp"
#include "drivers/velodyne/tables.hpp"

#include <cmath>
#include <vector>

#include <yaml-cpp/yaml.h>

namespace nilio::drivers {
namespace {

using core::Error;

constexpr const char* kMinIntensity = "min_intensity";
constexpr const char* kMaxIntensity = "max_intensity";
constexpr const char* kTwoPoint = "two_pt_correction_available";
constexpr const char* kEnabled = "enabled";

/// Keys other than those of kCalibrationFields; close_slope is accepted and ignored.
constexpr std::array<const char*, 6> kOtherKeys{"laser_id", kMinIntensity, kMaxIntensity,
                                                kTwoPoint,  kEnabled,      "close_slope"};

/// A laser being read, with path and id for error messages.
struct LaserNode {
  YAML::Node node;
  const std::string& path;
  std::size_t id;

  [[nodiscard]] Error error(const YAML::Node& at, const std::string& what) const;
};

std::string place(const std::string& path, const YAML::Mark& mark) {
  return mark.is_null() ? path : path + ":" + std::to_string(mark.line + 1);
}

Error LaserNode::error(const YAML::Node& at, const std::string& what) const {
  return Error{place(path, at.Mark()) + ": laser " + std::to_string(id) + ": " + what};
}

std::vector<std::string> known_keys() {
  std::vector<std::string> names(kOtherKeys.begin(), kOtherKeys.end());
  for (const CalibrationField& field : kCalibrationFields) names.emplace_back(field.yaml_key);
  return names;
}

std::optional<double> number(const YAML::Node& node) {
  double value = 0.0;
  if (!node.IsScalar() || !YAML::convert<double>::decode(node, value) || !std::isfinite(value)) {
    return std::nullopt;
  }
  return value;
}

std::optional<Error> read_fields(const LaserNode& in, LaserCalibration& laser) {
  for (const CalibrationField& field : kCalibrationFields) {
    const YAML::Node node = in.node[field.yaml_key];
    if (!node) {
      if (field.required_in_yaml) return in.error(in.node, std::string("has no ") + field.yaml_key);
      continue;
    }
    const std::optional<double> value = number(node);
    if (!value) return in.error(node, std::string(field.yaml_key) + " is not a number");
    const core::Result<double> si = to_si(field, *value, kYamlUnits);
    if (!si) return in.error(node, std::string(field.yaml_key) + " " + si.error().message);
    laser.*field.target = *si;
  }
  return std::nullopt;
}

std::optional<Error> read_intensity(const LaserNode& in, const char* key, std::uint8_t& limit) {
  const YAML::Node node = in.node[key];
  if (!node) return std::nullopt;
  const std::optional<double> value = number(node);
  const std::optional<std::uint8_t> intensity = value ? to_intensity(*value) : std::nullopt;
  if (!intensity) return in.error(node, std::string(key) + " is not a whole number of 0 to 255");
  limit = *intensity;
  return std::nullopt;
}

std::optional<Error> read_flag(const LaserNode& in, const char* key, bool& flag) {
  const YAML::Node node = in.node[key];
  if (!node) return std::nullopt;
  if (!node.IsScalar() || !YAML::convert<bool>::decode(node, flag)) {
    return in.error(node, std::string(key) + " is neither true nor false");
  }
  return std::nullopt;
}

std::optional<Error> find_unknown_key(const LaserNode& in, const std::vector<std::string>& known) {
  for (const auto& pair : in.node) {
    const std::string name = pair.first.IsScalar() ? pair.first.Scalar() : "?";
    if (std::find(known.begin(), known.end(), name) != known.end()) continue;
    return in.error(pair.first, "unknown key '" + name + "'" + nearest_name_hint(name, known));
  }
  return std::nullopt;
}

core::Result<LaserCalibration> read_laser(const LaserNode& in, const std::vector<std::string>& known) {
  LaserCalibration laser;
  bool two_point = true;
  if (auto error = read_fields(in, laser)) return *error;
  if (auto error = read_intensity(in, kMinIntensity, laser.min_intensity)) return *error;
  if (auto error = read_intensity(in, kMaxIntensity, laser.max_intensity)) return *error;
  if (auto error = read_flag(in, kTwoPoint, two_point)) return *error;
  if (auto error = read_flag(in, kEnabled, laser.enabled)) return *error;
  if (auto error = find_unknown_key(in, known)) return *error;
  if (const auto fault = laser_fault(laser)) return in.error(in.node, *fault);
  if (!two_point) laser.near_distance_correction_x_m = laser.near_distance_correction_y_m = 0.0;
  return laser;
}

core::Result<std::size_t> read_id(const YAML::Node& node, const std::string& path,
                                  const VelodyneSensor& sensor) {
  const std::size_t expected = sensor.lasers.size();
  if (!node.IsMap()) return Error{place(path, node.Mark()) + ": expected a laser, as '{laser_id: 0, ...}'"};
  const YAML::Node id_node = node["laser_id"];
  std::size_t id = 0;
  if (!id_node || !id_node.IsScalar() || !YAML::convert<std::size_t>::decode(id_node, id) || id >= expected) {
    return Error{place(path, id_node ? id_node.Mark() : node.Mark()) +
                 ": laser_id is missing or not one of 0.." + std::to_string(expected - 1) + " of a " +
                 sensor.name};
  }
  return id;
}

core::Result<VelodyneSensor> read_lasers(const YAML::Node& list, const std::string& path,
                                         VelodyneSensor sensor) {
  const std::vector<std::string> known = known_keys();
  std::vector<bool> seen(sensor.lasers.size(), false);
  for (const YAML::Node& node : list) {
    const core::Result<std::size_t> id = read_id(node, path, sensor);
    if (!id) return id.error();
    if (seen[*id]) {
      return Error{place(path, node["laser_id"].Mark()) + ": laser_id " + std::to_string(*id) +
                   " is there twice"};
    }
    seen[*id] = true;
    core::Result<LaserCalibration> laser = read_laser({node, path, *id}, known);
    if (!laser) return laser.error();
    sensor.lasers[*id] = *laser;
  }
  finish_geometry(sensor);
  return sensor;
}

core::Result<VelodyneSensor> read_document(VelodyneSensor sensor, const std::string& text,
                                           const std::string& path) {
  const YAML::Node root = YAML::Load(text);
  const YAML::Node list = root.IsMap() ? root["lasers"] : YAML::Node(YAML::NodeType::Undefined);
  if (!list || !list.IsSequence()) {
    return Error{path +
                 ": no list 'lasers'; expected a calibration as the ROS Velodyne driver has them, or " +
                 "Velodyne's db.xml"};
  }
  if (list.size() != sensor.lasers.size()) {
    return Error{place(path, list.Mark()) + ": " + std::to_string(list.size()) + " lasers, but a " +
                 sensor.name + " has " + std::to_string(sensor.lasers.size()) +
                 "; take the file of this model"};
  }
  return read_lasers(list, path, std::move(sensor));
}

}  // namespace

core::Result<VelodyneSensor> read_yaml_calibration(VelodyneSensor sensor, const std::string& text,
                                                   const std::string& path) {
  try {
    return read_document(std::move(sensor), text, path);
  } catch (const YAML::Exception& error) {
    return Error{place(path, error.mark) + ": " + error.msg};
  }
}

}  // namespace nilio::drivers
