#include "drivers/velodyne/calibration/calibration_fields.hpp"
#include "drivers/velodyne/tables.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <vector>

#include <pugixml.hpp>

namespace nilio::drivers {
namespace {

using core::Error;

/// Size of the file's arrays, the same for every model.
constexpr std::size_t kItems = 64;
/// Every model's beams span more; a smaller span means that the angles are not in degrees.
constexpr double kSmallestSpanRad = 5.0 * kXmlUnits.angle;

/// The document, with text and path for error messages.
struct Document {
  pugi::xml_node db;
  const std::string& text;
  const std::string& path;

  [[nodiscard]] Error error(std::ptrdiff_t offset, const std::string& what) const {
    if (offset < 0) return Error{path + ": " + what};
    const auto end = text.begin() + std::min(offset, static_cast<std::ptrdiff_t>(text.size()));
    return Error{path + ":" + std::to_string(std::count(text.begin(), end, '\n') + 1) + ": " + what};
  }
  [[nodiscard]] Error error(pugi::xml_node at, const std::string& what) const {
    return error(at.offset_debug(), what);
  }
  [[nodiscard]] Error laser_error(pugi::xml_node at, std::size_t id, const std::string& what) const {
    return error(at, "laser " + std::to_string(id) + ": " + what);
  }
};

/// Parses a number independently of the locale, unlike pugixml.
std::optional<double> number(pugi::xml_node node) {
  std::string_view text = node.child_value();
  const std::size_t first = text.find_first_not_of(" \t\r\n");
  if (first == std::string_view::npos) return std::nullopt;
  text = text.substr(first, text.find_last_not_of(" \t\r\n") - first + 1);
  double value = 0.0;
  const auto [end, failure] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (failure != std::errc{} || end != text.data() + text.size() || !std::isfinite(value))
    return std::nullopt;
  return value;
}

std::vector<pugi::xml_node> items(pugi::xml_node list) {
  std::vector<pugi::xml_node> found;
  for (const pugi::xml_node item : list.children("item")) found.push_back(item);
  return found;
}

/// Reads a list of one whole number of 0 to 255 per laser id; an absent list gives the value `absent`.
core::Result<std::vector<std::uint8_t>> read_list(const Document& in, const char* key, std::uint8_t absent) {
  const pugi::xml_node list = in.db.child(key);
  if (!list) return std::vector<std::uint8_t>(kItems, absent);
  std::vector<std::uint8_t> values;
  for (const pugi::xml_node item : items(list)) {
    const std::optional<double> value = number(item);
    const std::optional<std::uint8_t> byte = value ? to_intensity(*value) : std::nullopt;
    if (!byte) {
      return in.laser_error(item, values.size(), std::string(key) + " is not a whole number of 0 to 255");
    }
    values.push_back(*byte);
  }
  if (values.size() != kItems) {
    return in.error(list, std::string(key) + " has " + std::to_string(values.size()) + " items, expected " +
                              std::to_string(kItems));
  }
  return values;
}

struct Lists {
  std::vector<std::uint8_t> enabled;
  std::vector<std::uint8_t> min_intensity;
  std::vector<std::uint8_t> max_intensity;
};

core::Result<Lists> read_lists(const Document& in) {
  const auto enabled = read_list(in, "enabled_", 1);
  if (!enabled) return enabled.error();
  const auto min_intensity = read_list(in, "minIntensity_", 0);
  if (!min_intensity) return min_intensity.error();
  const auto max_intensity = read_list(in, "maxIntensity_", 255);
  if (!max_intensity) return max_intensity.error();
  return Lists{*enabled, *min_intensity, *max_intensity};
}

core::Result<std::size_t> read_id(const Document& in, pugi::xml_node item) {
  const pugi::xml_node node = item.child("px").child("id_");
  const std::optional<double> id = node ? number(node) : std::nullopt;
  if (!id || *id < 0.0 || *id >= static_cast<double>(kItems) || *id != std::floor(*id)) {
    return in.error(node ? node : item, "px has no id_ of 0 to 63");
  }
  return static_cast<std::size_t>(*id);
}

core::Result<LaserCalibration> read_laser(const Document& in, pugi::xml_node px, std::size_t id,
                                          const Lists& lists) {
  LaserCalibration laser;
  for (const CalibrationField& field : kCalibrationFields) {
    const pugi::xml_node node = px.child(field.xml_key);
    if (!node) {
      if (field.required_in_xml) return in.laser_error(px, id, std::string("has no ") + field.xml_key);
      continue;
    }
    const std::optional<double> value = number(node);
    if (!value) return in.laser_error(node, id, std::string(field.xml_key) + " is not a number");
    const core::Result<double> si = to_si(field, *value, kXmlUnits);
    if (!si) return in.laser_error(node, id, std::string(field.xml_key) + " " + si.error().message);
    laser.*field.target = *si;
  }
  laser.min_intensity = lists.min_intensity[id];
  laser.max_intensity = lists.max_intensity[id];
  laser.enabled = lists.enabled[id] != 0;
  if (const auto fault = laser_fault(laser)) return in.laser_error(px, id, *fault);
  return laser;
}

/// Reads the lasers by id. Files of smaller sensors also list 64, with the surplus switched off.
core::Result<VelodyneSensor> read_points(const Document& in, VelodyneSensor sensor) {
  const core::Result<Lists> lists = read_lists(in);
  if (!lists) return lists.error();
  const std::size_t expected = sensor.lasers.size();
  std::vector<bool> seen(kItems, false);
  for (const pugi::xml_node item : items(in.db.child("points_"))) {
    const core::Result<std::size_t> id = read_id(in, item);
    if (!id) return id.error();
    if (seen[*id]) return in.laser_error(item, *id, "is there twice");
    seen[*id] = true;
    if (*id >= expected) {
      if (lists->enabled[*id] == 0) continue;
      return in.laser_error(item, *id,
                            "is switched on, but a " + sensor.name + " has " + std::to_string(expected) +
                                " lasers; take the file of this model");
    }
    const core::Result<LaserCalibration> laser = read_laser(in, item.child("px"), *id, *lists);
    if (!laser) return laser.error();
    sensor.lasers[*id] = *laser;
  }
  const auto missing = std::find(seen.begin(), seen.begin() + static_cast<std::ptrdiff_t>(expected), false);
  if (const auto id = static_cast<std::size_t>(missing - seen.begin()); id < expected) {
    return in.error(in.db, "points_ has no laser " + std::to_string(id) + ", but a " + sensor.name + " has " +
                               std::to_string(expected));
  }
  return sensor;
}

std::optional<Error> check_resolution(const Document& in, const VelodyneSensor& sensor) {
  const pugi::xml_node node = in.db.child("distLSB_");
  if (!node) return std::nullopt;
  const std::optional<double> value = number(node);
  if (!value) return in.error(node, "distLSB_ is not a number");
  // Files have single precision.
  const double expected = sensor.distance_resolution_m / kXmlUnits.length;
  if (std::abs(*value - expected) < 1e-6) return std::nullopt;
  return in.error(node, "distLSB_ is " + format_number(*value) + " cm, but a " + sensor.name +
                            " measures in " + format_number(expected) + " cm; take the file of this model");
}

std::optional<Error> check_span(const Document& in, const VelodyneSensor& sensor) {
  const auto [lowest, highest] = std::minmax_element(
      sensor.lasers.begin(), sensor.lasers.end(),
      [](const LaserCalibration& a, const LaserCalibration& b) { return a.elevation_rad < b.elevation_rad; });
  const double span = highest->elevation_rad - lowest->elevation_rad;
  if (span >= kSmallestSpanRad) return std::nullopt;
  return in.error(in.db.child("points_"), "vertCorrection_ spans only " +
                                              format_number(span / kXmlUnits.angle) +
                                              " over all lasers; angles are in degrees");
}

core::Result<VelodyneSensor> read_document(VelodyneSensor sensor, const Document& in) {
  if (!in.db.child("points_")) {
    return Error{in.path + ": XML without boost_serialization/DB/points_; expected Velodyne's db.xml"};
  }
  if (sensor.lasers.size() > kItems) {
    return Error{in.path + ": a db.xml has 64 lasers at most, but a " + sensor.name + " has " +
                 std::to_string(sensor.lasers.size()) + "; take a YAML file"};
  }
  if (auto error = check_resolution(in, sensor)) return *error;
  core::Result<VelodyneSensor> read = read_points(in, std::move(sensor));
  if (!read) return read.error();
  if (auto error = check_span(in, *read)) return *error;
  finish_geometry(*read);
  return read;
}

}  // namespace

core::Result<VelodyneSensor> read_xml_calibration(VelodyneSensor sensor, const std::string& text,
                                                  const std::string& path) {
  pugi::xml_document xml;
  const pugi::xml_parse_result parsed = xml.load_buffer(text.data(), text.size());
  Document in{xml.child("boost_serialization").child("DB"), text, path};
  if (!parsed) return in.error(parsed.offset, std::string("not well-formed XML: ") + parsed.description());
  return read_document(std::move(sensor), in);
}

}  // namespace nilio::drivers
