#include "tools/simulate/town/building.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace nilio::tools::simulation {

namespace {

using core::SE3;
using core::Vector3;

/// The ground may fall away under a long building.
constexpr double kFoundationM = 2.0;
constexpr double kEavesM = 0.4;

/// One wall with its relief. Frame: x along the wall, centred, y outwards from the ground plan's edge, z up.
void add_wall(TriangleMesh& mesh, const SE3& T_mesh_wall, double length_m, const BuildingPlan& plan) {
  const double height = plan.floors * plan.floor_height_m;
  const int bays = std::max(1, static_cast<int>(length_m / plan.bay_m));
  const double bay = length_m / bays;
  const double pier = 0.5 * bay;
  for (int i = 0; i <= bays; ++i) {
    const double centre = -0.5 * length_m + bay * i;
    const double low = std::max(-0.5 * length_m, centre - 0.5 * pier);
    const double high = std::min(0.5 * length_m, centre + 0.5 * pier);
    mesh.add_box(T_mesh_wall, {low, -plan.recess_m, -kFoundationM}, {high, 0.0, height}, plan.wall);
  }
  for (int floor = 0; floor <= plan.floors; ++floor) {
    const double z = floor * plan.floor_height_m;
    const double sill = floor == plan.floors ? height : z + 0.9;
    // Spandrels lie a little behind the piers, ledges a little before the windows: a wall is not one plane.
    mesh.add_box(T_mesh_wall, {-0.5 * length_m, -plan.recess_m, floor == 0 ? -kFoundationM : z - 0.5},
                 {0.5 * length_m, -0.3 * plan.recess_m, sill}, plan.wall);
  }
}

void add_balconies(TriangleMesh& mesh, const SE3& T_mesh_wall, const BuildingPlan& plan) {
  const int bays = std::max(1, static_cast<int>(plan.length_m / plan.bay_m));
  const double bay = plan.length_m / bays;
  for (int floor = 1; floor < plan.floors; ++floor) {
    for (int i = floor % 2; i < bays; i += 2) {
      const double centre = -0.5 * plan.length_m + bay * (i + 0.5);
      const double z = floor * plan.floor_height_m + 0.2;
      mesh.add_box(T_mesh_wall, {centre - 0.45 * bay, -0.1, z}, {centre + 0.45 * bay, 1.1, z + 0.15},
                   plan.wall);
      mesh.add_box(T_mesh_wall, {centre - 0.45 * bay, 1.05, z}, {centre + 0.45 * bay, 1.1, z + 1.0},
                   Material::kMetal);
    }
  }
}

void add_pitched_roof(TriangleMesh& mesh, const SE3& T_mesh_building, const BuildingPlan& plan) {
  const double x = 0.5 * plan.length_m + 0.2;
  const double y = 0.5 * plan.depth_m + kEavesM;
  const double eaves = plan.floors * plan.floor_height_m - kEavesM * std::tan(plan.roof_pitch_rad);
  const double ridge = eaves + y * std::tan(plan.roof_pitch_rad);
  const auto at = [&](double px, double py, double pz) { return T_mesh_building * Vector3(px, py, pz); };
  mesh.add_quad(at(-x, -y, eaves), at(x, -y, eaves), at(x, 0, ridge), at(-x, 0, ridge), Material::kRoofTile);
  mesh.add_quad(at(-x, y, eaves), at(x, y, eaves), at(x, 0, ridge), at(-x, 0, ridge), Material::kRoofTile);
  for (const double side : {-0.5 * plan.length_m, 0.5 * plan.length_m}) {
    mesh.add_triangle(at(side, -y, eaves), at(side, y, eaves), at(side, 0, ridge), plan.wall);
  }
  const double chimney = 0.3 * plan.length_m;
  mesh.add_box(T_mesh_building, {chimney, 0.8, eaves}, {chimney + 0.8, 1.5, ridge + 0.8}, Material::kBrick);
}

void add_flat_roof(TriangleMesh& mesh, const SE3& T_mesh_building, const BuildingPlan& plan) {
  const double x = 0.5 * plan.length_m;
  const double y = 0.5 * plan.depth_m;
  const double height = plan.floors * plan.floor_height_m;
  mesh.add_box(T_mesh_building, {-x, -y, height}, {x, y, height + 0.1}, plan.wall);
  for (const double side : {-1.0, 1.0}) {
    const double inner_y = side * (y - 0.3);
    const double inner_x = side * (x - 0.3);
    mesh.add_box(T_mesh_building, {-x, std::min(inner_y, side * y), height},
                 {x, std::max(inner_y, side * y), height + 0.7}, plan.wall);
    mesh.add_box(T_mesh_building, {std::min(inner_x, side * x), -y, height},
                 {std::max(inner_x, side * x), y, height + 0.7}, plan.wall);
  }
  mesh.add_box(T_mesh_building, {-0.4 * x, -0.4 * y, height}, {0.1 * x, 0.3 * y, height + 2.4},
               Material::kMetal);
}

}  // namespace

BuildingPlan random_building_plan(double length_m, double depth_m, RandomStream& random) {
  BuildingPlan plan;
  plan.length_m = length_m;
  plan.depth_m = depth_m;
  plan.floors = 1 + static_cast<int>(random.index(length_m > 14.0 ? 5 : 3)) + (length_m > 10.0 ? 1 : 0);
  plan.floor_height_m = random.uniform(2.7, 3.4);
  plan.recess_m = random.uniform(0.12, 0.35);
  plan.bay_m = random.uniform(2.2, 4.2);
  plan.roof_pitch_rad = plan.floors > 4 || random.chance(0.25) ? 0.0 : random.uniform(0.45, 0.8);
  plan.balconies = plan.floors > 1 && random.chance(0.3);
  plan.wall = random.chance(0.6) ? Material::kPlaster : Material::kBrick;
  return plan;
}

void add_building(TriangleMesh& mesh, const SE3& T_mesh_building, const BuildingPlan& plan) {
  const double x = 0.5 * plan.length_m;
  const double y = 0.5 * plan.depth_m;
  const double height = plan.floors * plan.floor_height_m;
  // What shows between piers and spandrels is the core: the windows.
  mesh.add_box(T_mesh_building, {-x + plan.recess_m, -y + plan.recess_m, -kFoundationM},
               {x - plan.recess_m, y - plan.recess_m, height}, Material::kGlass);
  const double quarter = 0.5 * std::numbers::pi;
  const SE3 T_building_front = upright_frame({0.0, -y, 0.0}, -2.0 * quarter);
  add_wall(mesh, T_mesh_building * T_building_front, plan.length_m, plan);
  add_wall(mesh, T_mesh_building * upright_frame({0.0, y, 0.0}, 0.0), plan.length_m, plan);
  add_wall(mesh, T_mesh_building * upright_frame({x, 0.0, 0.0}, -quarter), plan.depth_m, plan);
  add_wall(mesh, T_mesh_building * upright_frame({-x, 0.0, 0.0}, quarter), plan.depth_m, plan);
  if (plan.balconies) add_balconies(mesh, T_mesh_building * T_building_front, plan);
  if (plan.roof_pitch_rad > 0.0) {
    add_pitched_roof(mesh, T_mesh_building, plan);
  } else {
    add_flat_roof(mesh, T_mesh_building, plan);
  }
}

}  // namespace nilio::tools::simulation
