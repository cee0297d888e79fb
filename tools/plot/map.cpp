#include "tools/plot/map.hpp"

#include "tools/common/trajectory.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <limits>
#include <optional>
#include <sstream>

namespace nilio::tools::plot {

namespace {

static_assert(std::endian::native == std::endian::little, "PLY values are copied as they are in the file");

constexpr std::uint64_t kMaxPoints = 500'000'000;

struct PlyField {
  std::size_t offset = 0;
  bool is_double = false;
};

struct PlyLayout {
  std::uint64_t count = 0;
  std::size_t stride = 0;
  std::optional<PlyField> x;
  std::optional<PlyField> y;
  std::optional<PlyField> z;
};

std::size_t ply_type_size(const std::string& type) {
  if (type == "char" || type == "uchar" || type == "int8" || type == "uint8") return 1;
  if (type == "short" || type == "ushort" || type == "int16" || type == "uint16") return 2;
  if (type == "int" || type == "uint" || type == "int32" || type == "uint32" || type == "float" ||
      type == "float32") {
    return 4;
  }
  return type == "double" || type == "float64" ? 8 : 0;
}

/// Reads a header line. Returns an error text, or an empty one.
std::string add_ply_header_line(const std::string& line, bool& in_vertices, PlyLayout& layout) {
  std::istringstream words(line);
  std::string keyword;
  std::string type;
  std::string name;
  words >> keyword >> type >> name;
  if (keyword == "format" && type != "binary_little_endian") {
    return "only binary_little_endian is read, not " + type;
  }
  if (keyword == "element") {
    in_vertices = type == "vertex";
    if (!in_vertices && layout.stride == 0) return "vertices have to be the first element";
    if (in_vertices && !(std::istringstream(name) >> layout.count)) {
      return "the number of vertices cannot be read";
    }
  }
  if (keyword != "property" || !in_vertices) return {};
  const std::size_t size = ply_type_size(type);
  if (size == 0) return "property type '" + type + "' is not supported for vertices";
  const PlyField field{layout.stride, type == "double" || type == "float64"};
  const bool is_real = field.is_double || type == "float" || type == "float32";
  layout.stride += size;
  if (name == "x" && is_real) layout.x = field;
  if (name == "y" && is_real) layout.y = field;
  if (name == "z" && is_real) layout.z = field;
  return {};
}

float read_field(const char* record, const PlyField& field) {
  if (field.is_double) {
    double value = 0.0;
    std::memcpy(&value, record + field.offset, sizeof(value));
    return static_cast<float>(value);
  }
  float value = 0.0F;
  std::memcpy(&value, record + field.offset, sizeof(value));
  return value;
}

core::Result<PlyLayout> read_ply_header(std::ifstream& file, const std::string& path) {
  PlyLayout layout;
  bool in_vertices = false;
  std::string line;
  for (std::size_t number = 1; number < 1000 && std::getline(file, line); ++number) {
    if (line.ends_with('\r')) line.pop_back();
    if (number == 1 && line != "ply") break;
    if (line == "end_header") {
      if (layout.x && layout.y && layout.z && layout.count <= kMaxPoints) return layout;
      return core::Error{path + ": needs vertices with x, y, z as float or double"};
    }
    const std::string problem = add_ply_header_line(line, in_vertices, layout);
    if (!problem.empty()) return core::Error{line_error(path, number, problem)};
  }
  return core::Error{
      path + ": is no PLY file (no header from \"ply\" to \"end_header\") - give a map as .ply or .xyz"};
}

core::Result<std::vector<Eigen::Vector3f>> read_ply(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) return core::Error{path + ": cannot be opened - give a map as .ply or .xyz"};
  const auto layout = read_ply_header(file, path);
  if (!layout) return layout.error();
  std::vector<Eigen::Vector3f> points;
  std::vector<char> record(layout->stride);
  for (std::uint64_t i = 0; i < layout->count; ++i) {
    file.read(record.data(), static_cast<std::streamsize>(record.size()));
    if (!file) {
      return core::Error{path + ": ends after " + std::to_string(i) + " of " + std::to_string(layout->count) +
                         " points, the file is incomplete - write or copy it again"};
    }
    const Eigen::Vector3f point(read_field(record.data(), *layout->x), read_field(record.data(), *layout->y),
                                read_field(record.data(), *layout->z));
    if (point.allFinite()) points.push_back(point);
  }
  return points;
}

core::Result<std::vector<Eigen::Vector3f>> read_xyz(const std::string& path) {
  std::ifstream file(path);
  if (!file) return core::Error{path + ": cannot be opened - give a map as .ply or .xyz"};
  std::vector<Eigen::Vector3f> points;
  std::string line;
  for (std::size_t number = 1; std::getline(file, line); ++number) {
    if (line.find_first_not_of(" \t\r") == std::string::npos || line.starts_with('#')) continue;
    const auto numbers = parse_numbers(line);
    if (!numbers || numbers->size() < 3) {
      return core::Error{path + ":" + std::to_string(number) + ": needs three finite numbers, x y z"};
    }
    const Eigen::Vector3d point((*numbers)[0], (*numbers)[1], (*numbers)[2]);
    points.push_back(point.cast<float>());
  }
  return points;
}

/// Colour scale from deep blue over green to warm yellow, dark enough on white.
Colour height_colour(double share) {
  constexpr std::array<Colour, 5> stops{
      {{0.20, 0.25, 0.50}, {0.17, 0.48, 0.56}, {0.25, 0.65, 0.45}, {0.68, 0.74, 0.25}, {0.93, 0.69, 0.13}}};
  const double position = std::clamp(share, 0.0, 1.0) * (stops.size() - 1);
  const std::size_t i = std::min(static_cast<std::size_t>(position), stops.size() - 2);
  const double t = position - static_cast<double>(i);
  const auto mix = [t](double a, double b) { return a + t * (b - a); };
  return {mix(stops[i].red, stops[i + 1].red), mix(stops[i].green, stops[i + 1].green),
          mix(stops[i].blue, stops[i + 1].blue)};
}

std::uint32_t premultiplied(const Colour& colour, double alpha) {
  const auto byte = [](double value) { return static_cast<std::uint32_t>(std::lround(255.0 * value)); };
  return byte(alpha) << 24U | byte(alpha * colour.red) << 16U | byte(alpha * colour.green) << 8U |
         byte(alpha * colour.blue);
}

/// Range of the colour scale: the 2 % and 98 % quantiles of the heights.
std::pair<float, float> height_range(std::vector<float> heights) {
  const auto quantile = [&heights](double share) {
    const auto at =
        heights.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(heights.size() - 1));
    std::nth_element(heights.begin(), at, heights.end());
    return *at;
  };
  const float low = quantile(0.02);
  return {low, std::max(quantile(0.98), low + 0.1F)};
}

}  // namespace

core::Result<std::vector<Eigen::Vector3f>> read_map_points(const std::string& path) {
  if (path.ends_with(".ply")) return read_ply(path);
  if (path.ends_with(".xyz")) return read_xyz(path);
  return core::Error{path + ": the extension of a map has to be .ply or .xyz"};
}

Raster rasterise_map(const std::vector<Eigen::Vector3f>& points, const Axes& axes) {
  Raster raster{static_cast<int>(axes.area.width), static_cast<int>(axes.area.height), {}};
  const auto pixel_count = static_cast<std::size_t>(raster.width) * static_cast<std::size_t>(raster.height);
  raster.pixels.assign(pixel_count, 0);
  std::vector<std::uint32_t> counts(pixel_count, 0);
  std::vector<float> tops(pixel_count, -std::numeric_limits<float>::infinity());
  std::vector<float> heights;
  for (const Eigen::Vector3f& point : points) {
    const Eigen::Vector2d pixel =
        axes.to_pixel({point.x(), point.y()}) - Eigen::Vector2d(axes.area.x, axes.area.y);
    if (!(pixel.x() >= 0.0 && pixel.y() >= 0.0 && pixel.x() < raster.width && pixel.y() < raster.height)) {
      continue;
    }
    const std::size_t i = static_cast<std::size_t>(pixel.y()) * static_cast<std::size_t>(raster.width) +
                          static_cast<std::size_t>(pixel.x());
    ++counts[i];
    tops[i] = std::max(tops[i], point.z());
    heights.push_back(point.z());
  }
  if (heights.empty()) return raster;
  const auto [low, high] = height_range(std::move(heights));
  for (std::size_t i = 0; i < pixel_count; ++i) {
    if (counts[i] == 0) continue;
    const double alpha = std::min(0.85, 0.35 + 0.15 * std::log2(static_cast<double>(counts[i])));
    raster.pixels[i] =
        premultiplied(height_colour(static_cast<double>((tops[i] - low) / (high - low))), alpha);
  }
  return raster;
}

}  // namespace nilio::tools::plot
