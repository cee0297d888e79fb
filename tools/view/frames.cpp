#include "tools/view/frames.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>

namespace nilio::tools::view {

static_assert(std::endian::native == std::endian::little, "frames are little-endian");

Frame::Frame(std::span<const std::uint8_t> content) : bytes_(kRoom + content.size()) {
  std::copy(content.begin(), content.end(), bytes_.begin() + kRoom);
}

Frame::Frame(const FrameHeader& header, std::span<const std::uint8_t> data)
    : bytes_(kRoom + sizeof header + data.size()) {
  std::memcpy(content(), &header, sizeof header);
  std::copy(data.begin(), data.end(), bytes_.begin() + kRoom + sizeof header);
}

bool pack(const std::array<float, 3>& position, const std::array<double, 3>& origin, float scale,
          PackedPoint& packed) {
  constexpr double kLimit = std::numeric_limits<std::int16_t>::max();
  std::array<std::int16_t*, 3> out{&packed.x, &packed.y, &packed.z};
  for (std::size_t i = 0; i < 3; ++i) {
    const double steps =
        std::round((static_cast<double>(position[i]) - origin[i]) / static_cast<double>(scale));
    if (!(std::abs(steps) <= kLimit)) return false;
    *out[i] = static_cast<std::int16_t>(steps);
  }
  return true;
}

FramePtr scan_frame(std::span<const ViewPoint> points, const std::array<double, 3>& origin, float time_s) {
  FrameHeader header{
      .kind = FrameKind::kScan, .value = PointValue::kIntensity, .origin = origin, .time_s = time_s};
  std::vector<PackedPoint> packed;
  packed.reserve(points.size());
  for (const ViewPoint& point : points) {
    PackedPoint one{.value = point.intensity};
    if (pack(point.position, origin, header.scale, one)) packed.push_back(one);
  }
  header.count = static_cast<std::uint32_t>(packed.size());
  return std::make_shared<Frame>(header, std::span(reinterpret_cast<const std::uint8_t*>(packed.data()),
                                                   packed.size() * sizeof(PackedPoint)));
}

FramePtr path_frame(std::span<const PathVertex> vertices, bool first) {
  // A path that begins anew replaces the one before.
  const FrameHeader header{
      .kind = FrameKind::kPath, .id = first ? 0U : 1U, .count = static_cast<std::uint32_t>(vertices.size())};
  return std::make_shared<Frame>(
      header, std::span(reinterpret_cast<const std::uint8_t*>(vertices.data()), vertices.size_bytes()));
}

}  // namespace nilio::tools::view
