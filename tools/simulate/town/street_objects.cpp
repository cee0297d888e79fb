#include "tools/simulate/town/street_objects.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace nilio::tools::simulate {

namespace {

using core::SE3;
using core::Vector3;

/// Heights and longitudinal positions of a car's body.
struct CarShape {
  CarSize size;
  double bonnet_m;       ///< height of the bonnet
  double roof_m;         ///< height of the roof
  double rear_glass_m;   ///< x of the rear window's foot and top, from the rear end
  double rear_roof_m;    //
  double front_roof_m;   ///< x of the windscreen's top and foot, from the front end
  double front_glass_m;  //
};

constexpr std::array<CarShape, kCarModels> kCarShapes{{{{3.9, 1.70}, 0.92, 1.47, 0.15, 0.50, 1.65, 1.05},
                                                       {{4.6, 1.80}, 0.90, 1.43, 0.75, 1.35, 1.95, 1.25},
                                                       {{4.7, 1.82}, 0.95, 1.52, 0.10, 0.35, 1.90, 1.20},
                                                       {{5.3, 1.98}, 1.15, 2.30, 0.02, 0.10, 1.35, 0.75}}};

constexpr double kClearanceM = 0.22;

constexpr CarSize kTruckSize{16.5, 2.55};
constexpr CarSize kBusSize{12.0, 2.55};

void add_wheels(TriangleMesh& mesh, double x, double half_width) {
  for (const double side : {-1.0, 1.0}) {
    const double outer = side * half_width;
    const double inner = side * (half_width - 0.4);
    mesh.add_box({}, {x - 0.5, std::min(outer, inner), 0.0}, {x + 0.5, std::max(outer, inner), 1.0},
                 Material::kTyre);
  }
}

/// Tractor unit with a gap to a boxy trailer.
TriangleMesh make_truck() {
  TriangleMesh mesh;
  const double x = 0.5 * kTruckSize.length_m;
  const double y = 0.5 * kTruckSize.width_m;
  mesh.add_box({}, {-x, -y, 1.1}, {x - 3.2, y, 4.0}, Material::kCarPaint);
  mesh.add_box({}, {x - 2.3, -y + 0.05, 0.5}, {x, y - 0.05, 3.6}, Material::kCarPaint);
  mesh.add_box({}, {x - 5.5, -0.45, 0.7}, {x - 2.3, 0.45, 1.1}, Material::kMetal);
  mesh.add_box({}, {x, -y + 0.2, 1.7}, {x + 0.02, y - 0.2, 2.8}, Material::kGlass);
  for (const double wheel_x : {-x + 2.0, -x + 3.3, -x + 4.6, x - 4.6, x - 1.2}) add_wheels(mesh, wheel_x, y);
  mesh.add_box({}, {-x - 0.02, -1.0, 0.9}, {-x, 1.0, 1.05}, Material::kRetroreflector);
  return mesh;
}

TriangleMesh make_bus() {
  TriangleMesh mesh;
  const double x = 0.5 * kBusSize.length_m;
  const double y = 0.5 * kBusSize.width_m;
  mesh.add_box({}, {-x, -y, 0.3}, {x, y, 1.2}, Material::kCarPaint);
  mesh.add_box({}, {-x, -y + 0.03, 1.2}, {x, y - 0.03, 2.6}, Material::kGlass);
  mesh.add_box({}, {-x, -y, 2.6}, {x, y, 3.1}, Material::kCarPaint);
  for (double pillar = -x; pillar < x; pillar += 1.5) {
    mesh.add_box({}, {pillar, -y, 1.2}, {pillar + 0.15, y, 2.6}, Material::kCarPaint);
  }
  for (const double wheel_x : {-x + 3.0, x - 2.7}) add_wheels(mesh, wheel_x, y);
  return mesh;
}

/// One small leaf-like triangle at `centre`, turned at random.
void add_leaf(TriangleMesh& mesh, const Vector3& centre, double size_m, RandomStream& random) {
  const auto offset = [&]() -> Vector3 {
    return size_m * Vector3(random.uniform(-1.0, 1.0), random.uniform(-1.0, 1.0), random.uniform(-1.0, 1.0));
  };
  const Vector3 a = centre + offset();
  const Vector3 b = centre + offset();
  const Vector3 c = centre + offset();
  mesh.add_triangle(a, b, c, Material::kFoliage);
}

/// Random numbers that a solid plant takes for a leaf; a porous one skips them, so that both towns are alike.
constexpr std::uint64_t kDrawsPerLeaf = 13;

PorousVolume foliage(const Vector3& half_size, double leaf_area_density) {
  PorousVolume volume;
  volume.half_size = half_size.cast<float>();
  // Half of the leaf area is across the ray.
  volume.extinction = static_cast<float>(0.5 * leaf_area_density);
  return volume;
}

/// Random point in the unit ball, more often near its surface.
Vector3 point_in_crown(RandomStream& random) {
  Vector3 p(random.gaussian(), random.gaussian(), random.gaussian());
  if (p.norm() < 1e-9) p = Vector3::UnitZ();
  return p.normalized() * std::sqrt(random.uniform(0.1, 1.0));
}

/// The ground may be lower under a long building.
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

CarSize car_size(std::size_t model) {
  return model == kTruckModel ? kTruckSize : model == kBusModel ? kBusSize : kCarShapes[model].size;
}

TriangleMesh make_car(std::size_t model) {
  if (model == kTruckModel) return make_truck();
  if (model == kBusModel) return make_bus();
  const CarShape& shape = kCarShapes[model];
  TriangleMesh mesh;
  const double x = 0.5 * shape.size.length_m;
  const double y = 0.5 * shape.size.width_m;
  mesh.add_box({}, {-x, -y, kClearanceM}, {x, y, shape.bonnet_m}, Material::kCarPaint);
  // The cabin narrows upwards.
  const double inset = 0.12 * shape.size.width_m;
  const auto foot = [&](double px, double side) { return Vector3(px, side * y, shape.bonnet_m); };
  const auto top = [&](double px, double side) { return Vector3(px, side * (y - inset), shape.roof_m); };
  const double rear_foot = -x + shape.rear_glass_m;
  const double rear_top = -x + shape.rear_roof_m;
  const double front_top = x - shape.front_roof_m;
  const double front_foot = x - shape.front_glass_m;
  for (const double side : {-1.0, 1.0}) {
    mesh.add_quad(foot(rear_foot, side), foot(front_foot, side), top(front_top, side), top(rear_top, side),
                  shape.roof_m > 2.0 ? Material::kCarPaint : Material::kGlass);
  }
  mesh.add_quad(foot(front_foot, -1), foot(front_foot, 1), top(front_top, 1), top(front_top, -1),
                Material::kGlass);
  mesh.add_quad(foot(rear_foot, -1), foot(rear_foot, 1), top(rear_top, 1), top(rear_top, -1),
                Material::kGlass);
  mesh.add_quad(top(rear_top, -1), top(rear_top, 1), top(front_top, 1), top(front_top, -1),
                Material::kCarPaint);
  for (const double wheel_x : {-0.62 * x, 0.62 * x}) {
    for (const double side : {-1.0, 1.0}) {
      const double outer = side * (y + 0.01);
      const double inner = side * (y - 0.2);
      mesh.add_box({}, {wheel_x - 0.3, std::min(outer, inner), 0.0},
                   {wheel_x + 0.3, std::max(outer, inner), 0.6}, Material::kTyre);
    }
  }
  for (const double end : {-1.0, 1.0}) {
    const double plate = end * (x + 0.02);
    mesh.add_box({}, {std::min(plate, end * x), -0.26, 0.45}, {std::max(plate, end * x), 0.26, 0.56},
                 Material::kRetroreflector);
  }
  return mesh;
}

void add_tree(TriangleMesh& mesh, const SE3& T_mesh_tree, double crown_radius_m, RandomStream& random) {
  constexpr double leaf_m = 0.25;
  constexpr double crown_foot_m = 2.4;
  const double half_height = crown_radius_m * random.uniform(0.9, 1.5);
  const double centre = crown_foot_m + leaf_m + half_height;
  mesh.add_column(T_mesh_tree, random.uniform(0.1, 0.28), -0.5, centre, Material::kBark);
  const Vector3 radii(crown_radius_m - leaf_m, crown_radius_m - leaf_m, half_height);
  const int leaves = static_cast<int>(130.0 * crown_radius_m);
  if (mesh.porous_plants) {
    random.skip(kDrawsPerLeaf * static_cast<std::uint64_t>(leaves));
    RandomStream own(random.next(), 1);
    // Leaf area density, m^2/m^3: an open crown has 0.5, a street tree 1.
    mesh.add_volume(T_mesh_tree, {0.0, 0.0, centre},
                    foliage({crown_radius_m, crown_radius_m, half_height + leaf_m}, own.uniform(0.3, 1.0)));
    return;
  }
  for (int i = 0; i < leaves; ++i) {
    const Vector3 p = Vector3(0.0, 0.0, centre) + radii.cwiseProduct(point_in_crown(random));
    add_leaf(mesh, T_mesh_tree * p, leaf_m, random);
  }
}

void add_bush(TriangleMesh& mesh, const SE3& T_mesh_bush, double radius_m, RandomStream& random) {
  constexpr double leaf_m = 0.12;
  constexpr int leaves = 70;
  if (mesh.porous_plants) {
    random.skip(kDrawsPerLeaf * leaves);
    RandomStream own(random.next(), 1);
    mesh.add_volume(T_mesh_bush, {0.0, 0.0, 0.6 * radius_m},
                    foliage({radius_m, radius_m, 0.8 * radius_m}, own.uniform(0.8, 2.5)));
    return;
  }
  for (int i = 0; i < leaves; ++i) {
    const Vector3 p = (radius_m - leaf_m) * point_in_crown(random) + Vector3(0.0, 0.0, 0.6 * radius_m);
    add_leaf(mesh, T_mesh_bush * p, leaf_m, random);
  }
}

void add_hedge(TriangleMesh& mesh, const SE3& T_mesh_hedge, double length_m, double height_m) {
  constexpr double kDepthM = 0.7;
  constexpr double kLeafAreaDensity = 2.5;
  PorousVolume hedge = foliage({0.5 * length_m, 0.5 * kDepthM, 0.5 * height_m}, kLeafAreaDensity);
  hedge.shape = PorousVolume::Shape::kBox;
  mesh.add_volume(T_mesh_hedge, {0.0, 0.0, 0.5 * height_m}, hedge);
}

void add_fence(TriangleMesh& mesh, const SE3& T_mesh_fence, double length_m, double height_m) {
  constexpr double kPostsM = 2.5;
  for (double x = -0.5 * length_m; x <= 0.5 * length_m; x += kPostsM)
    mesh.add_box(T_mesh_fence, {x - 0.03, -0.03, -0.3}, {x + 0.03, 0.03, height_m}, Material::kMetal);
  // Wire mesh: a fifth of the light meets a wire.
  constexpr double kThickM = 0.04;
  constexpr double kShare = 0.2;
  PorousVolume wires;
  wires.half_size = Eigen::Vector3d(0.5 * length_m, 0.5 * kThickM, 0.5 * height_m).cast<float>();
  wires.shape = PorousVolume::Shape::kBox;
  wires.extinction = static_cast<float>(-std::log(1.0 - kShare) / kThickM);
  wires.cell_m = 0.04F;
  wires.material = Material::kWire;
  mesh.add_volume(T_mesh_fence, {0.0, 0.0, 0.5 * height_m}, wires);
}

void add_wire(TriangleMesh& mesh, const Vector3& from, const Vector3& to, double sag_m) {
  constexpr int kPieces = 8;
  constexpr double kThickM = 0.02;
  const auto at = [&](int i) {
    const double share = static_cast<double>(i) / kPieces;
    Vector3 p = from + share * (to - from);
    p.z() -= 4.0 * sag_m * share * (1.0 - share);
    return p;
  };
  const Vector3 aside = Vector3(from.y() - to.y(), to.x() - from.x(), 0.0).normalized() * kThickM;
  for (int i = 0; i < kPieces; ++i) {
    const Vector3 up(0.0, 0.0, kThickM);
    mesh.add_quad(at(i), at(i + 1), at(i + 1) + up, at(i) + up, Material::kWire);
    mesh.add_quad(at(i), at(i + 1), at(i + 1) + aside, at(i) + aside, Material::kWire);
  }
}

void add_clutter(TriangleMesh& mesh, const SE3& T_mesh_object, RandomStream& random) {
  switch (random.index(4)) {
    case 0:  // bins
      mesh.add_box(T_mesh_object, {-0.3, -0.28, 0.0}, {0.3, 0.28, 1.05}, Material::kCarPaint);
      mesh.add_box(T_mesh_object, {0.36, -0.28, 0.0}, {0.94, 0.25, 0.95}, Material::kCarPaint);
      break;
    case 1:  // a bicycle: two wheels and a frame of bars
      for (const double x : {-0.5, 0.5}) {
        mesh.add_box(T_mesh_object, {x - 0.33, -0.02, 0.02}, {x + 0.33, 0.02, 0.10}, Material::kTyre);
        mesh.add_box(T_mesh_object, {x - 0.33, -0.02, 0.58}, {x + 0.33, 0.02, 0.66}, Material::kTyre);
        mesh.add_box(T_mesh_object, {x - 0.04, -0.02, 0.05}, {x + 0.04, 0.02, 0.95}, Material::kMetal);
      }
      mesh.add_box(T_mesh_object, {-0.5, -0.02, 0.55}, {0.5, 0.02, 0.62}, Material::kMetal);
      mesh.add_box(T_mesh_object, {0.45, -0.3, 0.95}, {0.5, 0.3, 1.0}, Material::kMetal);
      break;
    case 2:  // a cabinet
      mesh.add_box(T_mesh_object, {-0.5, -0.18, 0.0}, {0.5, 0.18, random.uniform(0.8, 1.5)},
                   Material::kPavement);
      break;
    default:  // a person
      mesh.add_column(T_mesh_object, 0.18, 0.0, 1.45, Material::kPlaster);
      mesh.add_column(T_mesh_object, 0.10, 1.45, 1.75, Material::kPlaster);
      break;
  }
}

void add_lamp(TriangleMesh& mesh, const SE3& T_mesh_lamp, RandomStream& random) {
  const double height = random.uniform(6.0, 8.5);
  mesh.add_column(T_mesh_lamp, random.uniform(0.06, 0.11), -0.5, height, Material::kMetal);
  mesh.add_box(T_mesh_lamp, {0.0, -0.04, height - 0.1}, {1.5, 0.04, height}, Material::kMetal);
  mesh.add_box(T_mesh_lamp, {1.0, -0.15, height - 0.15}, {1.6, 0.15, height + 0.05}, Material::kMetal);
}

void add_sign(TriangleMesh& mesh, const SE3& T_mesh_sign, RandomStream& random) {
  const double height = random.uniform(2.2, 2.8);
  mesh.add_column(T_mesh_sign, 0.035, -0.5, height, Material::kMetal);
  mesh.add_box(T_mesh_sign, {-0.06, -0.3, height - 0.6}, {-0.04, 0.3, height}, Material::kRetroreflector);
}

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
  // The core between piers and spandrels is the windows.
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

}  // namespace nilio::tools::simulate
