#pragma once

#include "nilio/core/result.hpp"

#include "tools/simulate/geometry/mesh.hpp"
#include "tools/simulate/geometry/surface.hpp"
#include "tools/simulate/scenes/traffic.hpp"

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

namespace nilio::tools::simulate {

inline constexpr std::size_t kRayGroup = 16;

/// Rays that are cast together, world coordinates; directions are unit vectors.
struct RayGroup {
  std::array<Eigen::Vector3f, kRayGroup> origin;
  std::array<Eigen::Vector3f, kRayGroup> direction;
  std::array<double, kRayGroup> time_s{};
};

/// A retroreflector of the static scene; patches of more than a metre are several.
struct Retroreflector {
  Eigen::Vector3f centre;
  float radius_m = 0.0F;
};

/// A car that may be near during a span of time, and its centre in that span.
struct NearbyCar {
  const MovingCar* car = nullptr;
  Eigen::Vector3f centre;
  /// Bounding radius around the centre.
  float radius_m = 0.0F;
};

/// Ray casting (Embree) against static geometry, porous bodies and moving vehicles, each at its pose at the
/// ray's own time. Casting is const and thread-safe; results do not depend on the number of threads.
class RayScene {
 public:
  /// Fails when Embree cannot start or there is not enough memory.
  static core::Result<RayScene> create(const TriangleMesh& still, std::vector<MovingCar> cars,
                                       const SurfaceDetail& detail = {});
  RayScene(RayScene&&) noexcept;
  RayScene& operator=(RayScene&&) noexcept;
  RayScene(const RayScene&) = delete;
  RayScene& operator=(const RayScene&) = delete;
  ~RayScene();

  [[nodiscard]] const std::vector<MovingCar>& cars() const;
  [[nodiscard]] const std::vector<Retroreflector>& retroreflectors() const;
  /// Cars within `range_m` of a place at a time; replaces the content of `nearby`.
  void find_cars(double time_s, const core::Vector3& place, double range_m,
                 std::vector<NearbyCar>& nearby) const;
  /// `nearby`: the result of find_cars() for a time within 10 ms of the rays' times.
  void cast(const RayGroup& rays, float max_distance_m, std::span<const NearbyCar> nearby,
            std::array<RayHit, kRayGroup>& hits) const;

 private:
  struct State;
  explicit RayScene(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace nilio::tools::simulate
