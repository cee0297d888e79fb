#include "tools/view/cloud.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <optional>
#include <string_view>

namespace nilio::tools::view {

namespace {

/// More than any sensor's scan; the rest is left out.
constexpr std::size_t kMaxPoints = 1'000'000;

std::optional<std::size_t> offset_of(const dds::PointCloud2& cloud, std::string_view name) {
  for (const dds::PointField& field : cloud.fields) {
    if (field.name == name && field.datatype == dds::PointField::kFloat32 &&
        std::uint64_t{field.offset} + sizeof(float) <= cloud.point_step)
      return field.offset;
  }
  return std::nullopt;
}

}  // namespace

std::vector<ViewPoint> points_of(const dds::PointCloud2& cloud) {
  const auto x = offset_of(cloud, "x");
  const auto y = offset_of(cloud, "y");
  const auto z = offset_of(cloud, "z");
  const auto intensity = offset_of(cloud, "intensity");
  const std::uint64_t row = std::uint64_t{cloud.point_step} * cloud.width;
  // Products of 32-bit numbers do not overflow 64 bits.
  if (!x || !y || !z || cloud.is_bigendian || row > cloud.row_step ||
      std::uint64_t{cloud.row_step} * cloud.height != cloud.data.size())
    return {};
  std::vector<ViewPoint> points;
  points.reserve(std::min<std::uint64_t>(std::uint64_t{cloud.width} * cloud.height, kMaxPoints));
  const auto read = [&cloud](std::size_t at) {
    float value = 0.0F;
    std::memcpy(&value, cloud.data.data() + at, sizeof value);
    return value;
  };
  for (std::uint32_t v = 0; v < cloud.height; ++v) {
    for (std::uint32_t u = 0; u < cloud.width && points.size() < kMaxPoints; ++u) {
      const std::size_t at = std::size_t{v} * cloud.row_step + std::size_t{u} * cloud.point_step;
      ViewPoint point{.position = {read(at + *x), read(at + *y), read(at + *z)}};
      if (!std::ranges::all_of(point.position, [](float value) { return std::isfinite(value); })) continue;
      if (intensity) {
        const float value = read(at + *intensity);
        point.intensity =
            static_cast<std::uint8_t>(std::isfinite(value) ? std::clamp(value, 0.0F, 255.0F) : 0.0F);
      }
      points.push_back(point);
    }
  }
  return points;
}

}  // namespace nilio::tools::view
