#pragma once

#include "tools/view/frames.hpp"

#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <vector>

namespace nilio::tools::view {

/// Points of a map in square tiles seen from above, one point a voxel, in bounded memory: at the limit the
/// tile without new points for longest is dropped. Points of a tile are only ever appended. One thread.
class PointTiles {
 public:
  struct Limits {
    double voxel_m = 0.3;
    std::size_t max_points = 2'000'000;
  };
  struct Tile {
    std::uint32_t id = 0;
    std::array<double, 3> origin{};
    std::vector<PackedPoint> points;
    std::uint64_t changed = 0;
  };
  static constexpr double kTileMetres = 50.0;

  explicit PointTiles(Limits limits);
  PointTiles(PointTiles&&) noexcept;
  PointTiles& operator=(PointTiles&&) noexcept;
  ~PointTiles();

  /// Adds the point if it is the first of its voxel. `value` is the fourth number of the packed point.
  void add(const std::array<float, 3>& position, std::uint16_t value);
  void clear();

  /// By id, increasing; an id is never used again.
  [[nodiscard]] const std::map<std::uint32_t, Tile>& tiles() const { return tiles_; }
  [[nodiscard]] std::size_t points() const { return points_; }
  /// Points that were dropped because of the limit.
  [[nodiscard]] std::uint64_t dropped() const { return dropped_; }

 private:
  struct Seen;
  Tile& tile_at(const std::array<float, 3>& position);
  void drop_oldest();

  Limits limits_;
  std::unique_ptr<Seen> seen_;
  std::map<std::uint32_t, Tile> tiles_;
  std::map<std::array<std::int64_t, 3>, std::uint32_t> ids_;
  std::uint32_t next_id_ = 1;
  std::uint64_t changes_ = 0;
  std::size_t points_ = 0;
  std::uint64_t dropped_ = 0;
};

/// Frame with the points of a tile from number `first` on.
FramePtr tile_frame(const PointTiles::Tile& tile, std::size_t first, PointValue value, float time_s);

}  // namespace nilio::tools::view
