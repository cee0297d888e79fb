#pragma once

#include "tools/simulate/geometry/mesh.hpp"
#include "tools/simulate/town/street_layout.hpp"

#include <cstdint>
#include <vector>

namespace nilio::tools::simulate {

/// Height of the ground. On the driven path it is the height and slope under the vehicle, elsewhere their
/// weighted mean, with unevenness of a few centimetres and gentle hills off the road. Immutable.
class Ground {
 public:
  Ground(const StreetLayout& layout, std::uint64_t seed);

  /// World z of the ground, metres; defined everywhere, valid within 90 m of the path. `sealed_plots`: part
  /// of the ground beside the road is paved; otherwise all of it is grass.
  [[nodiscard]] double height(const Vector2& p) const;
  [[nodiscard]] core::Vector3 on_ground(const Vector2& p) const { return {p.x(), p.y(), height(p)}; }
  /// Lowest ground under the corners of a footprint.
  [[nodiscard]] double lowest(const Footprint& footprint) const;
  /// Ground as triangles of about a metre, within 90 m of the path. `sealed_plots`: part of the ground
  /// beside the road is paved; otherwise all of it is grass.
  void append_to(TriangleMesh& mesh, const StreetLayout& layout, bool sealed_plots) const;

 private:
  [[nodiscard]] std::size_t node(std::int64_t column, std::int64_t row) const;
  [[nodiscard]] double unevenness(const Vector2& p) const;

  std::uint64_t seed_;
  Vector2 origin_ = Vector2::Zero();
  std::int64_t columns_ = 0;
  std::int64_t rows_ = 0;
  std::vector<float> heights_;
};

}  // namespace nilio::tools::simulate
