#pragma once

#include "tools/simulate/geometry/mesh.hpp"
#include "tools/simulate/random.hpp"

namespace nilio::tools::simulation {

/// What a building is to look like. Its frame has x along the street, y into the plot, the origin at the
/// centre of the ground plan on the ground.
struct BuildingPlan {
  double length_m = 12.0;  ///< along x
  double depth_m = 10.0;   ///< along y
  int floors = 3;
  double floor_height_m = 3.0;
  /// How far the windows lie behind the wall.
  double recess_m = 0.2;
  /// Wall piers from centre to centre.
  double bay_m = 3.0;
  /// 0 = flat with a parapet.
  double roof_pitch_rad = 0.6;
  bool balconies = false;
  Material wall = Material::kPlaster;
};

BuildingPlan random_building_plan(double length_m, double depth_m, RandomStream& random);

/// Walls with piers, spandrels and recessed windows, a cornice, and a pitched or flat roof. Nothing but the
/// eaves (0.4 m) and balconies (1.1 m, above 3 m, towards -y) stands out beyond the ground plan.
void add_building(TriangleMesh& mesh, const core::SE3& T_mesh_building, const BuildingPlan& plan);

}  // namespace nilio::tools::simulation
