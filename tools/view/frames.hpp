#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

namespace nilio::tools::view {

/// Point of a cloud in metres, with its intensity 0..255.
struct ViewPoint {
  std::array<float, 3> position{};
  std::uint8_t intensity = 0;
};

enum class FrameKind : std::uint16_t {
  kScan = 1,        ///< points of the newest scan; replaces the last one
  kTile = 2,        ///< points to add to the map tile `id`
  kPath = 3,        ///< vertices to add to the path
  kTileDropped = 4  ///< the map tile `id` is no longer kept
};

/// Meaning of the fourth number of a point.
enum class PointValue : std::uint16_t {
  kNone = 0,
  kIntensity = 1,
  kOrder = 2  ///< 0..65535 in the order of observation
};

/// Header of a binary message to the page. Little-endian; the data follow: 8 bytes a point (x, y, z as
/// int16 in steps of `scale` from `origin`, and a value), 32 bytes a vertex of the path.
struct FrameHeader {
  std::uint32_t magic = 0x314C494E;  // "NIL1"
  FrameKind kind = FrameKind::kScan;
  PointValue value = PointValue::kNone;
  std::uint32_t id = 0;
  std::uint32_t count = 0;
  std::array<double, 3> origin{};
  float scale = 0.01F;
  float time_s = 0.0F;  ///< since the start of the drive
};
static_assert(sizeof(FrameHeader) == 48);

/// Point on the wire.
struct PackedPoint {
  std::int16_t x = 0;
  std::int16_t y = 0;
  std::int16_t z = 0;
  std::uint16_t value = 0;
};
static_assert(sizeof(PackedPoint) == 8);

/// Vertex of the path on the wire; metres in odom.
struct PathVertex {
  double time_s = 0.0;  ///< since the start of the drive
  std::array<float, 3> position{};
  float speed_m_s = 0.0F;
  std::uint8_t state = 0;              ///< core::TrackingState
  std::uint8_t degradation_level = 0;  ///< core::DegradationLevel
  std::uint8_t degenerate_axes = 0;
  std::uint8_t reserved = 0;
  std::uint32_t sequence = 0;
};
static_assert(sizeof(PathVertex) == 32);

/// Bytes of a message behind room for the header of the transport; shared by all clients.
class Frame {
 public:
  static constexpr std::size_t kRoom = 64;

  explicit Frame(std::span<const std::uint8_t> content);
  Frame(const FrameHeader& header, std::span<const std::uint8_t> data);

  [[nodiscard]] std::uint8_t* content() { return bytes_.data() + kRoom; }
  [[nodiscard]] std::size_t size() const { return bytes_.size() - kRoom; }

 private:
  std::vector<std::uint8_t> bytes_;
};
using FramePtr = std::shared_ptr<Frame>;

/// Rounds a point to the step of a frame. False where it is outside the frame's range or not finite.
bool pack(const std::array<float, 3>& position, const std::array<double, 3>& origin, float scale,
          PackedPoint& packed);

/// Frame of a scan around `origin`; points out of range are left out.
FramePtr scan_frame(std::span<const ViewPoint> points, const std::array<double, 3>& origin, float time_s);
FramePtr path_frame(std::span<const PathVertex> vertices, bool first);

}  // namespace nilio::tools::view
