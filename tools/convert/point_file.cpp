#include "tools/convert/point_file.hpp"

#include "nilio/core/units.hpp"

#include "tools/common/files.hpp"

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <cstring>
#include <fstream>

namespace nilio::tools::convert {

namespace {

/// A field of a point, with its type in both binary formats.
struct Field {
  const char* name;
  char pcd_type;
  std::size_t bytes;
  const char* ply_type;
};

constexpr std::array<Field, 8> kFields{{{"x", 'F', 4, "float"},
                                        {"y", 'F', 4, "float"},
                                        {"z", 'F', 4, "float"},
                                        {"intensity", 'F', 4, "float"},
                                        {"ring", 'U', 2, "ushort"},
                                        {"return", 'U', 1, "uchar"},
                                        {"time", 'F', 4, "float"},
                                        {"azimuth", 'F', 4, "float"}}};

/// Degrees, 0 to 360.
float azimuth_of(const core::Point& point) {
  const double degrees =
      -std::atan2(static_cast<double>(point.y), static_cast<double>(point.x)) * kDegreesPerRadian;
  const auto azimuth = static_cast<float>(degrees < 0.0 ? degrees + 360.0 : degrees);
  return azimuth < 360.0F ? azimuth : 0.0F;
}

/// Values of a point in the order of kFields, without padding, in the byte order of the machine.
std::string binary_record(const core::Point& point) {
  std::string record;
  const auto add = [&record](const auto value) {
    std::array<char, sizeof value> bytes{};
    std::memcpy(bytes.data(), &value, sizeof value);
    record.append(bytes.data(), bytes.size());
  };
  for (const float value : {point.x, point.y, point.z, point.intensity}) add(value);
  add(point.ring);
  add(static_cast<std::uint8_t>(point.return_kind));
  add(static_cast<float>(1e-9 * point.time_offset_ns));
  add(azimuth_of(point));
  return record;
}

std::string csv_record(const core::Point& p) {
  std::array<char, 160> text{};
  std::snprintf(text.data(), text.size(), "%.6f,%.6f,%.6f,%g,%u,%u,%.9f,%.6f\n", static_cast<double>(p.x),
                static_cast<double>(p.y), static_cast<double>(p.z), static_cast<double>(p.intensity), p.ring,
                p.return_kind, 1e-9 * p.time_offset_ns, static_cast<double>(azimuth_of(p)));
  return text.data();
}

std::string pcd_header(std::size_t points) {
  std::array<std::string, 4> lines{"FIELDS", "SIZE", "TYPE", "COUNT"};
  for (const Field& field : kFields) {
    lines[0] += std::string(" ") + field.name;
    lines[1] += " " + std::to_string(field.bytes);
    lines[2] += std::string(" ") + field.pcd_type;
    lines[3] += " 1";
  }
  std::string text = "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\n";
  for (const std::string& line : lines) text += line + "\n";
  const std::string count = std::to_string(points);
  return text + "WIDTH " + count + "\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS " + count + "\nDATA binary\n";
}

std::string ply_header(std::size_t points) {
  std::string text = "ply\nformat binary_little_endian 1.0\nelement vertex " + std::to_string(points) + "\n";
  for (const Field& field : kFields)
    text += std::string("property ") + field.ply_type + " " + field.name + "\n";
  return text + "end_header\n";
}

std::string csv_header() {
  std::string text;
  for (const Field& field : kFields) text += std::string(text.empty() ? "" : ",") + field.name;
  return text + "\n";
}

}  // namespace

const char* extension_of(PointFormat format) {
  static constexpr std::array kExtensions{"pcd", "ply", "csv"};
  return kExtensions[static_cast<std::size_t>(format)];
}

core::Result<std::monostate> write_points(const core::Scan& scan, PointFormat format,
                                          const std::string& path) {
  std::string content = format == PointFormat::kPcd   ? pcd_header(scan.points.size())
                        : format == PointFormat::kPly ? ply_header(scan.points.size())
                                                      : csv_header();
  for (const core::Point& point : scan.points)
    content += format == PointFormat::kCsv ? csv_record(point) : binary_record(point);
  const UnfinishedFile unfinished(path);
  std::ofstream file(unfinished.path(), std::ios::binary);
  file.write(content.data(), static_cast<std::streamsize>(content.size()));
  file.close();
  if (!file) return core::Error{path + ": could not be written - check the folder and the space on the disk"};
  return unfinished.finish();
}

}  // namespace nilio::tools::convert
