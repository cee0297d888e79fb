#include "mapping/submap_codec.hpp"

#include "nilio/core/portable_math.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>

#include "mapping/crc32c.hpp"
#include "mapping/voxel_key.hpp"

namespace nilio::mapping {

namespace {

using core::Error;
using core::Result;

constexpr std::uint64_t kMagic = 0x5041'4D4F'494C'494E;  // "NILIOMAP", little endian
constexpr std::uint16_t kMajor = 1;
constexpr std::uint16_t kMinor = 0;
constexpr std::uint32_t kHeaderBytes = 80;
constexpr std::uint32_t kKeyframes = 0x4659'454B;  // "KEYF"
constexpr std::uint32_t kSurfaces = 0x4652'5553;   // "SURF"
constexpr std::size_t kKeyframeBytes = 8 + 7 * 8 + 21 * 4;
constexpr std::size_t kMinSurfaceBytes = 10;
// Logarithmic codes: 3 % a step.
constexpr double kLogBase = 1.03;
constexpr double kMinThicknessMetres = 0.001;
/// Powers of the base: the C library's pow() has other bits on other processors.
constexpr std::array<double, 256> kPowers = [] {
  std::array<double, 256> powers{1.0};
  for (std::size_t i = 1; i < powers.size(); ++i) powers[i] = kLogBase * powers[i - 1];
  return powers;
}();

std::uint8_t to_byte(double value) {
  return static_cast<std::uint8_t>(std::clamp(std::lround(value), 0L, 255L));
}

std::uint8_t encode_log(double value, double minimum) {
  return value <= minimum ? std::uint8_t{0}
                          : to_byte(portable::log(value / minimum) / portable::log(kLogBase));
}

double decode_log(std::uint8_t code, double minimum) { return minimum * kPowers[code]; }

/// Number of points: exact up to 32, then 3 % a step.
std::uint8_t encode_count(std::uint32_t count) {
  return count <= 32 ? static_cast<std::uint8_t>(count)
                     : to_byte(32 + portable::log(count / 32.0) / portable::log(kLogBase));
}

std::uint32_t decode_count(std::uint8_t code) {
  return code <= 32 ? code : static_cast<std::uint32_t>(std::lround(32.0 * kPowers[code - 32U]));
}

float voxel_of(bool plane) { return plane ? kPlaneVoxelMetres : kIrregularVoxelMetres; }

struct Row {
  VoxelKey key = 0;
  const Surface* surface = nullptr;
};

/// Surfaces of one kind: their number, key differences, then one column for each quantity.
void put_surfaces(const Submap& submap, bool planes, ByteWriter& out) {
  const float voxel = voxel_of(planes);
  std::vector<Row> rows;
  for (const Surface& surface : submap.surfaces) {
    if (surface.is_plane != planes) continue;
    if (const auto key = key_of(index_at(surface.mean, voxel))) rows.push_back({*key, &surface});
  }
  std::stable_sort(rows.begin(), rows.end(), [](const Row& a, const Row& b) { return a.key < b.key; });
  out.put(static_cast<std::uint32_t>(rows.size()));
  VoxelKey before = 0;
  for (const Row& row : rows) out.put_varint(row.key - std::exchange(before, row.key));
  for (int axis = 0; axis < 3; ++axis) {
    for (const Row& row : rows) {
      const float corner = static_cast<float>(index_of(row.key)[axis]) * voxel;
      out.put(to_byte((row.surface->mean[axis] - corner) / voxel * 256.0F - 0.5F));
    }
  }
  for (const Row& row : rows) out.put(encode_normal(row.surface->normal));
  for (const Row& row : rows) out.put(encode_log(row.surface->thickness_m, kMinThicknessMetres));
  for (const Row& row : rows) out.put(to_byte(row.surface->intensity));
  for (const Row& row : rows) out.put(encode_count(row.surface->points));
  for (const Row& row : rows) out.put(to_byte(row.surface->keyframe));
}

void get_surfaces(ByteReader& in, bool planes, Submap& submap) {
  const auto count = in.get<std::uint32_t>();
  if (count > in.left() / kMinSurfaceBytes) {
    in.get_bytes(std::numeric_limits<std::size_t>::max());  // fails
    return;
  }
  const float voxel = voxel_of(planes);
  std::vector<Surface> rows(count);
  std::vector<Eigen::Vector3i> indices(count);
  VoxelKey key = 0;
  for (std::size_t i = 0; i < count; ++i) {
    key = (key + static_cast<VoxelKey>(in.get_varint())) & ((1U << (3 * kKeyBits)) - 1);
    indices[i] = index_of(key);
    rows[i].is_plane = planes;
  }
  for (int axis = 0; axis < 3; ++axis) {
    for (std::size_t i = 0; i < count; ++i)
      rows[i].mean[axis] = (static_cast<float>(indices[i][axis]) +
                            (static_cast<float>(in.get<std::uint8_t>()) + 0.5F) / 256.0F) *
                           voxel;
  }
  for (Surface& row : rows) row.normal = decode_normal(in.get<std::uint16_t>());
  for (Surface& row : rows)
    row.thickness_m = static_cast<float>(decode_log(in.get<std::uint8_t>(), kMinThicknessMetres));
  for (Surface& row : rows) row.intensity = in.get<std::uint8_t>();
  for (Surface& row : rows) row.points = decode_count(in.get<std::uint8_t>());
  for (Surface& row : rows) row.keyframe = in.get<std::uint8_t>();
  if (!in.failed()) submap.surfaces.insert(submap.surfaces.end(), rows.begin(), rows.end());
}

Bytes keyframe_section(const Submap& submap) {
  ByteWriter out;
  put_pose(submap.T_odom_submap, out);
  out.put(static_cast<std::uint32_t>(submap.keyframes.size()));
  for (const SubmapKeyframe& keyframe : submap.keyframes) {
    out.put(keyframe.stamp.ns);
    put_pose(keyframe.T_submap_base, out);
    for (const float value : keyframe.covariance) out.put(value);
  }
  return out.take();
}

bool read_keyframes(std::span<const std::uint8_t> bytes, Submap& submap) {
  ByteReader in(bytes);
  submap.T_odom_submap = get_pose(in);
  const auto count = in.get<std::uint32_t>();
  if (!is_valid_pose(submap.T_odom_submap) || count > in.left() / kKeyframeBytes) return false;
  for (std::uint32_t i = 0; i < count; ++i) {
    SubmapKeyframe keyframe;
    keyframe.stamp.ns = in.get<std::int64_t>();
    keyframe.T_submap_base = get_pose(in);
    for (float& value : keyframe.covariance) value = in.get<float>();
    if (!is_valid_pose(keyframe.T_submap_base)) return false;
    submap.keyframes.push_back(keyframe);
  }
  return !in.failed();
}

bool read_surfaces(std::span<const std::uint8_t> bytes, Submap& submap) {
  ByteReader in(bytes);
  get_surfaces(in, true, submap);
  get_surfaces(in, false, submap);
  for (std::size_t i = 0; i < submap.surfaces.size(); ++i) {
    const Eigen::Vector3f& mean = submap.surfaces[i].mean;
    submap.minimum = i == 0 ? mean : Eigen::Vector3f(submap.minimum.cwiseMin(mean));
    submap.maximum = i == 0 ? mean : Eigen::Vector3f(submap.maximum.cwiseMax(mean));
  }
  return !in.failed();
}

}  // namespace

std::uint16_t encode_normal(const Eigen::Vector3f& normal) {
  // Octahedral projection (Cigolle et al. 2014): the lower half is folded over the corners of the upper one.
  const float sum = normal.cwiseAbs().sum();
  if (!(sum > 0.0F)) return encode_normal(Eigen::Vector3f::UnitZ());
  Eigen::Vector2f p = normal.head<2>() / sum;
  if (normal.z() < 0.0F)
    p = Eigen::Vector2f(std::copysign(1.0F - std::abs(p.y()), p.x()),
                        std::copysign(1.0F - std::abs(p.x()), p.y()));
  const auto code = [](float value) { return static_cast<unsigned>(to_byte((value + 1.0F) * 127.5F)); };
  return static_cast<std::uint16_t>(code(p.x()) | code(p.y()) << 8U);
}

Eigen::Vector3f decode_normal(std::uint16_t code) {
  const auto value = [](unsigned byte) { return static_cast<float>(byte) / 127.5F - 1.0F; };
  const float x = value(code & 0xFFU);
  const float y = value(code >> 8U);
  Eigen::Vector3f normal(x, y, 1.0F - std::abs(x) - std::abs(y));
  if (normal.z() < 0.0F) {
    normal.x() = std::copysign(1.0F - std::abs(y), x);
    normal.y() = std::copysign(1.0F - std::abs(x), y);
  }
  return normal.normalized();
}

Bytes encode_submap(const Submap& submap, const MapId& map, core::Time created) {
  ByteWriter surfaces;
  put_surfaces(submap, true, surfaces);
  put_surfaces(submap, false, surfaces);
  ByteWriter payload;
  for (const auto& [tag, content] : {std::pair<std::uint32_t, Bytes>{kKeyframes, keyframe_section(submap)},
                                     std::pair<std::uint32_t, Bytes>{kSurfaces, surfaces.take()}}) {
    payload.put(tag);
    payload.put(crc32c(content));
    payload.put(static_cast<std::uint64_t>(content.size()));
    payload.put_bytes(content);
  }
  ByteWriter out;
  out.put(kMagic);
  out.put(kMajor);
  out.put(kMinor);
  out.put(kHeaderBytes);
  out.put(std::uint64_t{0});  // features that a reader must know
  out.put(std::uint64_t{0});  // features that a reader may ignore
  out.put(static_cast<std::uint64_t>(payload.bytes().size()));
  out.put_bytes(map);
  out.put(created.ns);
  out.put(submap.id);
  out.put(std::uint64_t{0});  // reserved
  out.put(crc32c(out.bytes()));
  out.put_bytes(payload.bytes());
  return out.take();
}

Result<DecodedSubmap> decode_submap(std::span<const std::uint8_t> bytes, const std::string& name) {
  ByteReader in(bytes);
  DecodedSubmap result;
  if (in.get<std::uint64_t>() != kMagic) return Error{name + ": not a submap of nilio (wrong magic number)"};
  const auto major = in.get<std::uint16_t>();
  const auto minor = in.get<std::uint16_t>();
  const auto header_bytes = in.get<std::uint32_t>();
  const auto required = in.get<std::uint64_t>();
  in.get<std::uint64_t>();
  const auto payload_bytes = in.get<std::uint64_t>();
  const auto map = in.get_bytes(result.map.size());
  if (!map.empty()) std::copy(map.begin(), map.end(), result.map.begin());
  result.created.ns = in.get<std::int64_t>();
  result.submap.id = in.get<std::uint32_t>();
  in.get<std::uint64_t>();
  const auto checksum = in.get<std::uint32_t>();
  if (in.failed() || crc32c(bytes.first(kHeaderBytes - 4)) != checksum)
    return Error{name + ": damaged header - restore the file, or leave the submap out"};
  if (major != kMajor || required != 0 || header_bytes != kHeaderBytes)
    return Error{name + ": format " + std::to_string(major) + "." + std::to_string(minor) +
                 ", this program reads " + std::to_string(kMajor) + " - use a newer nilio"};
  if (payload_bytes != in.left())
    return Error{name + ": " + std::to_string(in.left()) + " bytes after the header instead of " +
                 std::to_string(payload_bytes) + " - the file is incomplete"};
  bool has_keyframes = false;
  bool has_surfaces = false;
  while (in.left() > 0) {
    const auto tag = in.get<std::uint32_t>();
    const auto section_checksum = in.get<std::uint32_t>();
    const auto size = in.get<std::uint64_t>();
    const auto content = in.get_bytes(size);
    if (in.failed() || crc32c(content) != section_checksum)
      return Error{name + ": damaged content (wrong checksum) - restore the file, or leave the submap out"};
    if (tag == kKeyframes) has_keyframes = read_keyframes(content, result.submap);
    if (tag == kSurfaces) has_surfaces = read_surfaces(content, result.submap);
  }
  if (!has_keyframes || !has_surfaces) return Error{name + ": impossible keyframes or surfaces"};
  return result;
}

}  // namespace nilio::mapping
