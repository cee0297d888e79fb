#include "tools/map/cloud_file.hpp"

#include <array>
#include <cstdio>
#include <filesystem>
#include <system_error>

#include "mapping/bytes.hpp"

namespace nilio::tools::map {

namespace {

/// Of the same length for any number of points.
std::string pcd_header(std::uint64_t points) {
  std::array<char, 32> padded{};
  std::snprintf(padded.data(), padded.size(), "%-20llu", static_cast<unsigned long long>(points));
  const std::string count = padded.data();
  return "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\n"
         "FIELDS x y z intensity normal_x normal_y normal_z curvature time\nSIZE 4 4 4 4 4 4 4 4 8\n"
         "TYPE F F F F F F F F F\nCOUNT 1 1 1 1 1 1 1 1 1\nWIDTH " +
         count + "\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS " + count + "\nDATA binary\n";
}

void put_pcd_row(const CloudPoint& point, mapping::ByteWriter& out) {
  for (int i = 0; i < 3; ++i) out.put(static_cast<float>(point.position[i]));
  out.put(point.intensity);
  for (int i = 0; i < 3; ++i) out.put(point.normal[i]);
  out.put(point.thickness_m);
  out.put(static_cast<double>(point.stamp.ns) * 1e-9);
}

}  // namespace

CloudFile::CloudFile(const std::string& path, ExportFormat format, const core::Vector3& centre)
    : path_(path), format_(format), unfinished_(path), file_(unfinished_.path(), std::ios::binary) {
  las_.offset = centre.array().round();
  file_ << header();
}

CloudFile::~CloudFile() {
  std::error_code ignored;
  std::filesystem::remove(unfinished_.path(), ignored);
}

std::string CloudFile::header() const {
  switch (format_) {
    case ExportFormat::kPly:
      return mapping::ply_header(points_);
    case ExportFormat::kPcd:
      return pcd_header(points_);
    case ExportFormat::kLas:
      return las_header(las_);
  }
  return {};
}

void CloudFile::add(std::span<const CloudPoint> points) {
  mapping::ByteWriter rows;
  for (const CloudPoint& point : points) {
    switch (format_) {
      case ExportFormat::kPly:
        put_ply_row(point, rows);
        break;
      case ExportFormat::kPcd:
        put_pcd_row(point, rows);
        break;
      case ExportFormat::kLas:
        put_las_point(point, las_, rows);
        break;
    }
  }
  points_ += points.size();
  const mapping::Bytes& bytes = rows.bytes();
  file_.write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
}

core::Result<std::monostate> CloudFile::finish() {
  file_.seekp(0);
  file_ << header();
  file_.close();
  if (file_) return unfinished_.finish();
  return cannot_write(path_);
}

}  // namespace nilio::tools::map
