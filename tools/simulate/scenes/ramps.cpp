#include "tools/simulate/geometry/road_line.hpp"
#include "tools/simulate/scenes/scene.hpp"
#include "tools/simulate/town/street_objects.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

namespace nilio::tools::simulate {

namespace {

using core::Vector3;

constexpr int kStoreys = 4;
constexpr double kStoreyM = 3.2;
constexpr double kSlabM = 0.25;
// The building; its centre is the origin.
constexpr double kHalfLengthM = 32.0;
constexpr double kHalfDepthM = 18.0;
// The driven lap: up the ramp on one long side, level on the others.
constexpr double kLapX = 24.0;
constexpr double kLapY = 9.0;
constexpr double kAisleHalfM = 3.0;
constexpr double kRampX = 15.0;
constexpr double kGateX = -110.0;
constexpr double kRampColumnsM = 8.0;

std::vector<Vector2> laps() {
  std::vector<Vector2> corners{{kGateX, -kLapY}};
  for (int storey = 0; storey < kStoreys; ++storey) {
    corners.emplace_back(kLapX, -kLapY);
    corners.emplace_back(kLapX, kLapY);
    if (storey + 1 == kStoreys) break;
    corners.emplace_back(-kLapX, kLapY);
    corners.emplace_back(-kLapX, -kLapY);
  }
  corners.emplace_back(-0.5 * kLapX, kLapY);
  return corners;
}

RoadLine make_lap_line(std::uint64_t seed) {
  const CornerRadii radii{5.0, 5.5, 5.0, 5.5};
  RoadLine line;
  line.route = make_route(round_corners(laps(), radii, RandomStream(seed, 280)), 6);
  double height = 0.0;
  for (std::size_t i = 0; i < line.route.points.size(); ++i) {
    const Vector2& p = line.route.points[i];
    const bool climbs = i > 0 && std::abs(p.y() + kLapY) < 0.5 && std::abs(p.x()) < kRampX;
    if (climbs) height += kStoreyM * std::abs(p.x() - line.route.points[i - 1].x()) / (2.0 * kRampX);
    line.heights.push_back(height);
  }
  line.heights = smooth(std::move(line.heights), 4, 2);
  return line;
}

class CarParkBuilder {
 public:
  CarParkBuilder(const RoadLine& line, const SceneConfig& config, TriangleMesh& mesh)
      : line_(line), mesh_(mesh), random_(config.seed, 281), density_(config.density) {}

  std::string build() {
    for (int storey = 0; storey <= kStoreys; ++storey) add_storey(storey);
    add_ramps();
    add_surroundings();
    return std::to_string(kStoreys) + " storeys, " + counted(columns_, "columns, ") +
           counted(cars_, "parked cars, ") + counted(houses_, "houses around");
  }

 private:
  void box(double x0, double x1, double y0, double y1, double z0, double z1, Material material) {
    mesh_.add_box({}, {x0, y0, z0}, {x1, y1, z1}, material);
  }

  void add_storey(int storey) {
    const double z = storey * kStoreyM;
    if (storey > 0) add_slab(z);
    add_parapets(storey);
    park_cars(z);
    if (storey == kStoreys) return;
    const double top = z + kStoreyM - kSlabM;
    add_columns(z, top);
    box(-3.0, 3.0, -5.0, 5.0, z, top, Material::kPavement);
    for (const double x : {-kHalfLengthM, kHalfLengthM - 0.2}) {
      for (const double y : {-kHalfDepthM, kHalfDepthM - 5.0})
        box(x, x + 0.2, y, y + 5.0, z, top, Material::kPavement);
    }
  }

  /// The slab has an opening above the ramp.
  void add_slab(double top) {
    const double low = top - kSlabM;
    const double inner = -kLapY + kAisleHalfM;
    const double outer = -kLapY - kAisleHalfM;
    box(-kHalfLengthM, kHalfLengthM, inner, kHalfDepthM, low, top, Material::kPavement);
    box(-kHalfLengthM, kHalfLengthM, -kHalfDepthM, outer, low, top, Material::kPavement);
    box(-kHalfLengthM, -kRampX, outer, inner, low, top, Material::kPavement);
    box(kRampX, kHalfLengthM, outer, inner, low, top, Material::kPavement);
  }

  void add_parapets(int storey) {
    const double z = storey * kStoreyM;
    for (const double y : {-kHalfDepthM, kHalfDepthM - 0.2})
      box(-kHalfLengthM, kHalfLengthM, y, y + 0.2, z, z + 1.1, Material::kPavement);
    box(kHalfLengthM - 0.2, kHalfLengthM, -kHalfDepthM, kHalfDepthM, z, z + 1.1, Material::kPavement);
    // The gate is on the ground floor.
    const double gate = storey == 0 ? -kLapY + kAisleHalfM : -kHalfDepthM;
    box(-kHalfLengthM, -kHalfLengthM + 0.2, gate, kHalfDepthM, z, z + 1.1, Material::kPavement);
  }

  void add_columns(double z, double top) {
    for (double x = -28.0; x <= 28.0; x += kRampColumnsM) {
      std::vector<double> places{-kLapY - kAisleHalfM - 0.4, kLapY + kAisleHalfM + 0.4};
      if (std::abs(x) < 20.0 && std::abs(x) > 3.0) places.push_back(0.0);
      for (const double y : places) {
        box(x - 0.25, x + 0.25, y - 0.25, y + 0.25, z, top, Material::kPavement);
        ++columns_;
      }
      // Beams, except across the ramp.
      const double foot = std::abs(x) < kRampX + 1.0 ? -kLapY + kAisleHalfM : -kHalfDepthM;
      box(x - 0.15, x + 0.15, foot, kHalfDepthM, top - 0.35, top, Material::kPavement);
      for (const double y : {-kHalfDepthM, kHalfDepthM - 0.3})
        box(x - 0.2, x + 0.2, y, y + 0.3, z, top, Material::kPavement);
    }
  }

  void park_cars(double z) {
    for (const double row : {-14.9, -2.9, 2.9, 14.9}) {
      const bool outside = std::abs(row) > 10.0;
      const double end = outside ? 28.0 : 17.5;
      for (double x = -end; x <= end; x += 2.7) {
        const bool free = random_.chance(std::min(1.0, 0.65 * density_)) && (outside || std::abs(x) > 4.3);
        const std::size_t model = random_.index(3);
        const double yaw = (random_.chance(0.5) ? 0.5 : -0.5) * std::numbers::pi + 0.03 * random_.gaussian();
        if (!free) continue;
        mesh_.append(make_car(model), upright_frame({x, row, z}, yaw));
        ++cars_;
      }
    }
  }

  /// Surface, underside and side walls along the climbing parts of the route.
  void add_ramps() {
    const Route& route = line_.route;
    const auto on_ramp = [&](std::size_t i) {
      return std::abs(route.points[i].y() + kLapY) < 0.5 && std::abs(route.points[i].x()) < kRampX + 1.5;
    };
    for (std::size_t i = 0; i < route.points.size(); ++i) {
      if (!on_ramp(i)) continue;
      Stretch stretch{route.arc_length[i], 0.0, 0.5};
      while (i + 1 < route.points.size() && on_ramp(i + 1)) ++i;
      stretch.to_m = route.arc_length[i];
      const double half = kAisleHalfM - 0.05;
      add_strip(mesh_, line_, stretch,
                {{-half, 0.8},
                 {-half, 0.0},
                 {half, 0.0},
                 {half, 0.8},
                 {half + 0.04, 0.8},
                 {half + 0.04, -kSlabM},
                 {-half - 0.04, -kSlabM},
                 {-half - 0.04, 0.8},
                 {-half, 0.8}},
                Material::kPavement);
    }
  }

  void add_surroundings() {
    HeightField field;
    field.cell_m = 4.0;
    field.reach_m = 130.0;
    field.height = [](const Vector2&) { return -0.02; };
    field.material = [](const Vector2&) { return Material::kAsphalt; };
    add_height_field(mesh_, {{-40.0, 0.0}}, field);
    for (double angle = 0.0; angle < 2.0 * std::numbers::pi; angle += random_.uniform(0.2, 0.45)) {
      const double far = random_.uniform(62.0, 85.0);
      const BuildingPlan plan = random_building_plan(random_.uniform(10.0, 22.0), 10.0, random_);
      const Vector2 p = far * direction(angle);
      if (std::abs(p.y() + kLapY) < 14.0 && p.x() < 0.0) continue;
      add_building(mesh_, upright_frame({p.x(), p.y(), 0.0}, angle - 0.5 * std::numbers::pi), plan);
      ++houses_;
    }
    for (double x = kGateX; x < -40.0; x += random_.uniform(6.0, 14.0)) {
      const double y = -kLapY + (random_.chance(0.5) ? 1.0 : -1.0) * random_.uniform(4.5, 7.0);
      add_tree(mesh_, upright_frame({x, y, 0.0}, x), random_.uniform(1.0, 1.8), random_);
    }
  }

  const RoadLine& line_;
  TriangleMesh& mesh_;
  RandomStream random_;
  double density_;
  std::size_t columns_ = 0;
  std::size_t cars_ = 0;
  std::size_t houses_ = 0;
};

}  // namespace

core::Result<Scene> build_ramps(const SceneConfig& config) {
  const RoadLine line = make_lap_line(config.seed);
  const double all_m = line.length_m() - 1.0;
  const double stop_m = config.extent.length_m > 0.0 ? std::min(all_m, config.extent.length_m) : all_m;
  DrivingStyle style;
  style.cruise_speed_m_s = *config.speed_m_s;
  style.moving_start = config.moving_start;
  const std::vector<double> travelled =
      arc_length_over_time(line.route, speed_profile(line.route, stop_m, style), stop_m, style);
  Scene scene;
  scene.mesh.porous_plants = config.porous_plants;
  scene.poses = cut_drive(drive_over(line.route, travelled, config.sway_speed(),
                                     [&](double at, const Vector2&) { return line.ground(at); }),
                          kControlIntervalS, config.extent);
  scene.contents = CarParkBuilder(line, config, scene.mesh).build();
  return scene;
}

}  // namespace nilio::tools::simulate
