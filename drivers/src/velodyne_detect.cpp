#include "nilio/drivers/velodyne_decoder.hpp"

#include "little_endian.hpp"
#include "velodyne_layout.hpp"

#include <algorithm>
#include <array>
#include <vector>

namespace nilio::drivers {
namespace {

constexpr std::uint8_t kProductHdl32e = 0x21;
constexpr std::uint8_t kProductVlp16 = 0x22;

enum class Shape { kUpperOnly, kAlternating, kOther };

Shape shape_of(const Packet& packet) {
  bool upper_only = true;
  bool alternating = true;
  for (std::size_t b = 0; b < kBlocksPerPacket; ++b) {
    const std::uint16_t flag = load_u16(packet.data.data() + b * kBlockSize);
    upper_only = upper_only && flag == kFlagUpper;
    alternating = alternating && flag == (b % 2 == 0 ? kFlagUpper : kFlagLower);
  }
  if (upper_only) return Shape::kUpperOnly;
  return alternating ? Shape::kAlternating : Shape::kOther;
}

/// Early VLP-16 call themselves HDL-32E. They are told by the time from packet to packet: 1327 us, not 553.
bool has_vlp16_period(const std::vector<std::uint32_t>& timestamps_us) {
  std::vector<std::uint32_t> periods;
  for (std::size_t i = 1; i < timestamps_us.size(); ++i)
    periods.push_back(timestamps_us[i] - timestamps_us[i - 1]);
  if (periods.size() < 3) return false;
  const auto middle = periods.begin() + static_cast<std::ptrdiff_t>(periods.size() / 2);
  std::nth_element(periods.begin(), middle, periods.end());
  return *middle >= 1320 && *middle <= 1335;
}

}  // namespace

std::optional<VelodyneModel> detect_velodyne_model(std::span<const Packet> packets) {
  std::optional<Shape> shape;
  std::optional<std::uint8_t> product;
  std::vector<std::uint32_t> timestamps_us;
  for (const Packet& packet : packets) {
    if (packet.size != kDataPacketSize || packet.truncated) continue;
    const Shape this_shape = shape_of(packet);
    if (shape && *shape != this_shape) return std::nullopt;
    shape = this_shape;
    // The HDL-64E has a status stream where others have the product.
    if (this_shape == Shape::kAlternating) continue;
    if (product && *product != packet.data[kProductOffset]) return std::nullopt;
    product = packet.data[kProductOffset];
    timestamps_us.push_back(load_u32(packet.data.data() + kTimestampOffset));
  }
  if (shape == Shape::kAlternating) return VelodyneModel::kHdl64eS2;
  if (shape != Shape::kUpperOnly) return std::nullopt;
  if (product == kProductVlp16) return VelodyneModel::kVlp16;
  if (product == kProductHdl32e && has_vlp16_period(timestamps_us)) return VelodyneModel::kVlp16;
  return std::nullopt;
}

}  // namespace nilio::drivers
