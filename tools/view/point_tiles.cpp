#include "tools/view/point_tiles.hpp"

#include "tools/view/voxel_cache.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

namespace nilio::tools::view {

namespace {

/// Beyond this a position is damaged, and its voxel would not fit its key.
constexpr float kMaxMetres = 2.0e5F;

std::uint64_t voxel_key(const std::array<float, 3>& position, double voxel_m) {
  std::uint64_t key = 0;
  for (const float value : position) {
    const auto cell = static_cast<std::int64_t>(std::floor(static_cast<double>(value) / voxel_m));
    key = key << 21U | (static_cast<std::uint64_t>(cell) & 0x1FFFFFU);
  }
  return key;
}

}  // namespace

struct PointTiles::Seen {
  VoxelCache voxels;
};

PointTiles::PointTiles(Limits limits) : limits_(limits), seen_(std::make_unique<Seen>()) {}
PointTiles::PointTiles(PointTiles&&) noexcept = default;
PointTiles& PointTiles::operator=(PointTiles&&) noexcept = default;
PointTiles::~PointTiles() = default;

void PointTiles::clear() {
  seen_ = std::make_unique<Seen>();
  tiles_.clear();
  ids_.clear();
  points_ = 0;
}

PointTiles::Tile& PointTiles::tile_at(const std::array<float, 3>& position) {
  std::array<std::int64_t, 3> key{};
  std::array<double, 3> origin{};
  for (std::size_t i = 0; i < 3; ++i) {
    // Tiles are columns; only unusual heights have more than one.
    const double size = i == 2 ? 8.0 * kTileMetres : kTileMetres;
    const double shifted = static_cast<double>(position[i]) + (i == 2 ? size / 2.0 : 0.0);
    key[i] = static_cast<std::int64_t>(std::floor(shifted / size));
    origin[i] = static_cast<double>(key[i]) * size + (i == 2 ? 0.0 : size / 2.0);
  }
  const auto [entry, is_new] = ids_.try_emplace(key, next_id_);
  if (is_new) tiles_[next_id_++] = {.id = entry->second, .origin = origin, .points = {}};
  return tiles_.at(entry->second);
}

void PointTiles::drop_oldest() {
  const auto oldest = std::min_element(tiles_.begin(), tiles_.end(), [](const auto& a, const auto& b) {
    return a.second.changed < b.second.changed;
  });
  points_ -= oldest->second.points.size();
  dropped_ += oldest->second.points.size();
  std::erase_if(ids_, [&](const auto& entry) { return entry.second == oldest->first; });
  tiles_.erase(oldest);
}

void PointTiles::add(const std::array<float, 3>& position, std::uint16_t value) {
  const bool is_near = std::all_of(position.begin(), position.end(),
                                   [](float metres) { return std::abs(metres) < kMaxMetres; });
  if (!is_near || !seen_->voxels.insert(voxel_key(position, limits_.voxel_m))) return;
  if (points_ >= limits_.max_points && tiles_.size() > 1) drop_oldest();
  Tile& tile = tile_at(position);
  PackedPoint packed{.value = value};
  if (!pack(position, tile.origin, FrameHeader{}.scale, packed)) return;
  tile.points.push_back(packed);
  tile.changed = ++changes_;
  ++points_;
}

FramePtr tile_frame(const PointTiles::Tile& tile, std::size_t first, PointValue value, float time_s) {
  const std::span<const PackedPoint> points = std::span(tile.points).subspan(first);
  const FrameHeader header{.kind = FrameKind::kTile,
                           .value = value,
                           .id = tile.id,
                           .count = static_cast<std::uint32_t>(points.size()),
                           .origin = tile.origin,
                           .time_s = time_s};
  return std::make_shared<Frame>(
      header, std::span(reinterpret_cast<const std::uint8_t*>(points.data()), points.size_bytes()));
}

}  // namespace nilio::tools::view
