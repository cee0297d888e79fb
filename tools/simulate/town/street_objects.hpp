#pragma once

#include "tools/simulate/geometry/mesh.hpp"
#include "tools/simulate/random.hpp"

namespace nilio::tools::simulate {

inline constexpr std::size_t kCarModels = 4;
/// Heavy vehicles follow the cars.
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

/// Trunk and a crown, of separate leaves or porous, above 2.4 m and within `crown_radius_m`.
void add_tree(TriangleMesh& mesh, const core::SE3& T_mesh_tree, double crown_radius_m, RandomStream& random);
/// Leaves down to the ground.
void add_bush(TriangleMesh& mesh, const core::SE3& T_mesh_bush, double radius_m, RandomStream& random);
/// Hedge along x, centred, 0.7 m deep.
void add_hedge(TriangleMesh& mesh, const core::SE3& T_mesh_hedge, double length_m, double height_m);
/// Fence of wire mesh on posts along x, centred.
void add_fence(TriangleMesh& mesh, const core::SE3& T_mesh_fence, double length_m, double height_m);
/// Overhead wire of 2 cm that hangs `sag_m` low.
void add_wire(TriangleMesh& mesh, const core::Vector3& from, const core::Vector3& to, double sag_m);
/// Bins, a bicycle, a cabinet or a person, within 1 m.
void add_clutter(TriangleMesh& mesh, const core::SE3& T_mesh_object, RandomStream& random);
/// Street lamp; its arm of 1.5 m points along x at 6 m height or more.
void add_lamp(TriangleMesh& mesh, const core::SE3& T_mesh_lamp, RandomStream& random);
/// Traffic sign that faces -x.
void add_sign(TriangleMesh& mesh, const core::SE3& T_mesh_sign, RandomStream& random);

/// Dimensions and style of a building. Its frame has x along the street, y into the plot, the origin on the
/// ground at the centre of the ground plan.
struct BuildingPlan {
  double length_m = 12.0;  ///< along x
  double depth_m = 10.0;   ///< along y
  int floors = 3;
  double floor_height_m = 3.0;
  /// Depth of the windows behind the wall.
  double recess_m = 0.2;
  /// Spacing of the wall piers.
  double bay_m = 3.0;
  /// 0 = flat with a parapet.
  double roof_pitch_rad = 0.6;
  bool balconies = false;
  Material wall = Material::kPlaster;
};

BuildingPlan random_building_plan(double length_m, double depth_m, RandomStream& random);

/// Adds walls with piers, spandrels and recessed windows, a cornice, and a pitched or flat roof. Only the
/// eaves (0.4 m) and balconies (1.1 m, above 3 m, towards -y) extend beyond the ground plan.
void add_building(TriangleMesh& mesh, const core::SE3& T_mesh_building, const BuildingPlan& plan);

}  // namespace nilio::tools::simulate
