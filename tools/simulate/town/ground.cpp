#include "tools/simulate/town/ground.hpp"

#include "tools/simulate/random.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <unordered_map>
#include <utility>

#include <tbb/parallel_for.h>

namespace nilio::tools::simulate {

namespace {

constexpr double kLatticeM = 2.0;
constexpr double kReachM = 90.0;
/// The street continues beyond the drive's ends, so that ground is needed this far from the driven path.
constexpr double kSupportM = 170.0;
/// Ground is computed and meshed in tiles of this many lattice squares.
constexpr std::int64_t kTile = 8;
/// Yards and drives: 45 % of Germany's settlement area is sealed (Umweltbundesamt).
constexpr double kSealedShare = 0.45;
constexpr double kPlotM = 6.0;

std::uint64_t cell_index(double value) {
  return static_cast<std::uint64_t>(static_cast<std::int64_t>(value));
}

/// Smooth noise in [-1, 1] with features of `wavelength_m`: random values on a lattice, blended.
double value_noise(std::uint64_t seed, const Vector2& p, double wavelength_m) {
  const double x = p.x() / wavelength_m;
  const double y = p.y() / wavelength_m;
  const double fx = std::floor(x);
  const double fy = std::floor(y);
  const auto value = [&](double dx, double dy) {
    const auto key_x = static_cast<std::uint64_t>(static_cast<std::int64_t>(fx + dx));
    const auto key_y = static_cast<std::uint64_t>(static_cast<std::int64_t>(fy + dy));
    return 2.0 * to_unit_interval(random_word(seed, key_x, key_y)) - 1.0;
  };
  const auto blend = [](double t) { return t * t * (3.0 - 2.0 * t); };
  const double u = blend(x - fx);
  const double v = blend(y - fy);
  const double low = value(0, 0) + u * (value(1, 0) - value(0, 0));
  const double high = value(0, 1) + u * (value(1, 1) - value(0, 1));
  return low + v * (high - low);
}

/// Height of the ground at p from the driven path: each sample is a plane near by, a height farther away.
double height_from_path(const std::vector<const StreetSample*>& path, const Vector2& p, std::uint64_t seed) {
  double sum = 0.0;
  double total = 0.0;
  double nearest = std::numeric_limits<double>::max();
  for (const StreetSample* sample : path) {
    const Vector2 offset = p - sample->position;
    const double d2 = offset.squaredNorm();
    const double weight = 1.0 / ((d2 + 4.0) * (d2 + 4.0));
    const double plane = d2 < 1500.0 ? std::exp(-d2 / 150.0) * sample->slope.dot(offset) : 0.0;
    sum += weight * (sample->z + plane);
    total += weight;
    nearest = std::min(nearest, d2);
  }
  const double hills = std::clamp((std::sqrt(nearest) - 8.0) / 30.0, 0.0, 1.0);
  return sum / total + 0.8 * hills * value_noise(seed, p, 25.0);
}

}  // namespace

Ground::Ground(const StreetLayout& layout, std::uint64_t seed) : seed_(random_word(seed, 31)) {
  std::vector<const StreetSample*> path;
  for (std::size_t i = 0; i < layout.samples().size(); i += 4) {
    if (layout.samples()[i].driven) path.push_back(&layout.samples()[i]);
  }
  // A vehicle that hardly moves has fewer than four samples.
  for (const StreetSample& sample : layout.samples()) {
    if (path.empty() && sample.driven) path.push_back(&sample);
  }
  Vector2 low = path.front()->position;
  Vector2 high = low;
  for (const StreetSample& sample : layout.samples()) {
    low = low.cwiseMin(sample.position);
    high = high.cwiseMax(sample.position);
  }
  origin_ = low - Vector2::Constant(kReachM);
  const Vector2 size = high - low + Vector2::Constant(2.0 * kReachM);
  const auto tiles = [](double length) {
    return static_cast<std::int64_t>(std::ceil(length / (kLatticeM * static_cast<double>(kTile))));
  };
  columns_ = tiles(size.x()) * kTile;
  rows_ = tiles(size.y()) * kTile;
  heights_.assign(static_cast<std::size_t>((columns_ + 1) * (rows_ + 1)),
                  std::numeric_limits<float>::quiet_NaN());

  tbb::parallel_for(std::int64_t{0}, rows_ + 1, [&](std::int64_t row) {
    // Only samples within reach of this row; otherwise a long drive takes minutes.
    const double y = origin_.y() + kLatticeM * static_cast<double>(row);
    std::vector<const StreetSample*> near_row;
    for (const StreetSample* sample : path) {
      if (std::abs(sample->position.y() - y) < kSupportM) near_row.push_back(sample);
    }
    std::vector<const StreetSample*> near_node;
    for (std::int64_t column = 0; column <= columns_; ++column) {
      const double x = origin_.x() + kLatticeM * static_cast<double>(column);
      near_node.clear();
      for (const StreetSample* sample : near_row) {
        if (std::abs(sample->position.x() - x) < kSupportM) near_node.push_back(sample);
      }
      if (near_node.empty()) continue;
      heights_[node(column, row)] = static_cast<float>(height_from_path(near_node, {x, y}, seed_));
    }
  });
}

std::size_t Ground::node(std::int64_t column, std::int64_t row) const {
  return static_cast<std::size_t>(row * (columns_ + 1) + column);
}

double Ground::unevenness(const Vector2& p) const {
  return 0.02 * value_noise(seed_ + 1, p, 4.0) + 0.008 * value_noise(seed_ + 2, p, 1.3);
}

double Ground::height(const Vector2& p) const {
  const double x = std::clamp((p.x() - origin_.x()) / kLatticeM, 0.0, static_cast<double>(columns_) - 1e-6);
  const double y = std::clamp((p.y() - origin_.y()) / kLatticeM, 0.0, static_cast<double>(rows_) - 1e-6);
  const auto column = static_cast<std::int64_t>(x);
  const auto row = static_cast<std::int64_t>(y);
  const double u = x - static_cast<double>(column);
  const double v = y - static_cast<double>(row);
  const auto at = [&](std::int64_t dx, std::int64_t dy) {
    return static_cast<double>(heights_[node(column + dx, row + dy)]);
  };
  const double low = at(0, 0) + u * (at(1, 0) - at(0, 0));
  const double high = at(0, 1) + u * (at(1, 1) - at(0, 1));
  const double height = low + v * (high - low);
  return std::isfinite(height) ? height + unevenness(p) : 0.0;
}

double Ground::lowest(const Footprint& footprint) const {
  const Vector2 along = 0.5 * footprint.length_m * direction(footprint.yaw_rad);
  const Vector2 across = 0.5 * footprint.width_m * left_of(direction(footprint.yaw_rad));
  return std::min({height(footprint.centre + along + across), height(footprint.centre + along - across),
                   height(footprint.centre - along + across), height(footprint.centre - along - across)});
}

void Ground::append_to(TriangleMesh& mesh, const StreetLayout& layout, bool sealed_plots) const {
  const std::int64_t tile_columns = columns_ / kTile;
  const std::int64_t tile_rows = rows_ / kTile;
  const double tile_m = kLatticeM * static_cast<double>(kTile);
  std::vector<bool> wanted(static_cast<std::size_t>(tile_columns * tile_rows), false);
  for (const StreetSample& sample : layout.samples()) {
    const Vector2 low = (sample.position - Vector2::Constant(kReachM) - origin_) / tile_m;
    const Vector2 high = (sample.position + Vector2::Constant(kReachM) - origin_) / tile_m;
    for (auto row = std::max<std::int64_t>(0, static_cast<std::int64_t>(low.y()));
         row < tile_rows && static_cast<double>(row) < high.y(); ++row) {
      for (auto column = std::max<std::int64_t>(0, static_cast<std::int64_t>(low.x()));
           column < tile_columns && static_cast<double>(column) < high.x(); ++column) {
        wanted[static_cast<std::size_t>(row * tile_columns + column)] = true;
      }
    }
  }
  // Vertices are shared by neighbouring squares.
  constexpr std::int64_t squares = 2 * kTile;
  constexpr double square_m = 0.5 * kLatticeM;
  std::unordered_map<std::int64_t, std::uint32_t> vertex_of;
  const auto vertex = [&](std::int64_t x, std::int64_t y) {
    const auto [found, added] = vertex_of.try_emplace(y * (tile_columns * squares + 1) + x, 0U);
    if (added) {
      found->second = mesh.add_vertex(
          on_ground(origin_ + square_m * Vector2(static_cast<double>(x), static_cast<double>(y))));
    }
    return found->second;
  };
  for (std::int64_t y = 0; y < tile_rows * squares; ++y) {
    for (std::int64_t x = 0; x < tile_columns * squares; ++x) {
      if (!wanted[static_cast<std::size_t>((y / squares) * tile_columns + x / squares)]) continue;
      const Vector2 centre =
          origin_ + square_m * Vector2(static_cast<double>(x) + 0.5, static_cast<double>(y) + 0.5);
      const bool road = (layout.use_at(centre) & cell_use::kRoad) != 0;
      const Vector2 plot = (centre / kPlotM).array().floor();
      const bool sealed = sealed_plots && to_unit_interval(random_word(seed_ + 3, cell_index(plot.x()),
                                                                       cell_index(plot.y()))) < kSealedShare;
      mesh.triangles.push_back({vertex(x, y), vertex(x + 1, y), vertex(x + 1, y + 1)});
      mesh.triangles.push_back({vertex(x, y), vertex(x + 1, y + 1), vertex(x, y + 1)});
      mesh.materials.insert(mesh.materials.end(), 2,
                            road     ? Material::kAsphalt
                            : sealed ? Material::kPavement
                                     : Material::kGrass);
    }
  }
}

}  // namespace nilio::tools::simulate
