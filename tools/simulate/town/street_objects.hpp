#pragma once

#include "tools/simulate/geometry/mesh.hpp"
#include "tools/simulate/random.hpp"

namespace nilio::tools::simulation {

inline constexpr std::size_t kCarModels = 4;
/// Larger ones after the cars.
inline constexpr std::size_t kTruckModel = 4;
inline constexpr std::size_t kBusModel = 5;
inline constexpr std::size_t kVehicleModels = 6;

/// Size of a car's ground plan, metres.
struct CarSize {
  double length_m = 0.0;
  double width_m = 0.0;
};
/// `model` is below kVehicleModels: hatchback, saloon, estate, van, articulated truck, bus.
CarSize car_size(std::size_t model);
/// Frame: x forward, z up, origin on the ground under the vehicle's centre.
TriangleMesh make_car(std::size_t model);

/// Trunk and a crown of loose leaves. Nothing of the crown is below 2.4 m, nor beyond `crown_radius_m`.
void add_tree(TriangleMesh& mesh, const core::SE3& T_mesh_tree, double crown_radius_m, RandomStream& random);
/// Leaves down to the ground.
void add_bush(TriangleMesh& mesh, const core::SE3& T_mesh_bush, double radius_m, RandomStream& random);
/// Street lamp; its arm of 1.5 m points along x at 6 m height or more.
void add_lamp(TriangleMesh& mesh, const core::SE3& T_mesh_lamp, RandomStream& random);
/// Traffic sign that faces -x.
void add_sign(TriangleMesh& mesh, const core::SE3& T_mesh_sign, RandomStream& random);

}  // namespace nilio::tools::simulation
