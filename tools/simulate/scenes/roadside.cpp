#include "tools/simulate/geometry/relief.hpp"
#include "tools/simulate/geometry/road_line.hpp"
#include "tools/simulate/scenes/scene.hpp"
#include "tools/simulate/town/street_objects.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <utility>

namespace nilio::tools::simulate {

namespace {

using core::SE3;
using core::Vector3;

constexpr double kRoadBeyondM = 120.0;
constexpr double kLongestRoadM = 20000.0;
constexpr double kRoadEdgeM = 4.0;

/// Objects along a road. Spacings in metres along the road, 0 = none; offsets to either side from its
/// middle.
struct RoadsidePlan {
  SceneKind kind;
  double bends = 0.0;   ///< amplitude of the heading, rad
  double relief = 0.0;  ///< steepness of the ground beside the road
  double ground_m = 70.0;
  double trees_m = 0.0;
  double tree_offset_m = 6.0;
  double bushes_m = 0.0;
  double posts_m = 0.0;  ///< identical
  double post_offset_m = 3.5;
  double houses_m = 0.0;
  double house_offset_m = 30.0;
  bool railings = false;
  double roughness_m3 = 64e-6;
  double washboard_m = 0.0;
  double joints_m = 0.0;
};

constexpr std::array kPlans{
    RoadsidePlan{.kind = SceneKind::kAvenue,
                 .bends = 0.05,
                 .relief = 0.002,
                 .trees_m = 8.0,
                 .houses_m = 40.0,
                 .house_offset_m = 22.0},
    RoadsidePlan{
        .kind = SceneKind::kField, .bends = 0.1, .relief = 0.004, .bushes_m = 90.0, .posts_m = 100.0},
    RoadsidePlan{.kind = SceneKind::kBridge,
                 .ground_m = 6.0,
                 .posts_m = 40.0,
                 .post_offset_m = 5.5,
                 .railings = true,
                 .joints_m = 20.0},
    RoadsidePlan{.kind = SceneKind::kSquare,
                 .ground_m = 90.0,
                 .posts_m = 60.0,
                 .post_offset_m = 25.0,
                 .houses_m = 26.0,
                 .house_offset_m = 75.0},
    RoadsidePlan{.kind = SceneKind::kRailway,
                 .ground_m = 60.0,
                 .posts_m = 50.0,
                 .post_offset_m = 3.2,
                 .roughness_m3 = 16e-6,
                 .joints_m = 15.0},
    RoadsidePlan{.kind = SceneKind::kWashboard,
                 .bends = 0.15,
                 .relief = 0.006,
                 .trees_m = 30.0,
                 .tree_offset_m = 9.0,
                 .bushes_m = 12.0,
                 .roughness_m3 = 1024e-6,
                 .washboard_m = 0.012},
};

const RoadsidePlan& plan_of(SceneKind kind) {
  return *std::find_if(kPlans.begin(), kPlans.end(),
                       [&](const RoadsidePlan& plan) { return plan.kind == kind; });
}

class RoadsideBuilder {
 public:
  RoadsideBuilder(const RoadLine& line, const RoadsidePlan& plan, const SceneConfig& config,
                  TriangleMesh& mesh)
      : line_(line),
        plan_(plan),
        config_(config),
        mesh_(mesh),
        random_(config.seed, 291),
        relief_(RandomStream(config.seed, 292), 8.0, 60.0, plan.relief) {}

  std::string build() {
    add_ground();
    std::size_t objects = 0;
    for (const double side : {-1.0, 1.0}) {
      if (plan_.railings) add_railing(side);
      objects += along(plan_.trees_m, 0.2, [&](double at) { add_tree_at(at, side); });
      objects += along(plan_.bushes_m, 1.0, [&](double at) {
        const double off = side * random_.uniform(6.0, 30.0);
        add_bush(mesh_, frame(at, off), random_.uniform(0.4, 1.4), random_);
      });
      objects += along(plan_.houses_m, 0.5, [&](double at) { add_house(at, side); });
      if (config_.clutter && plan_.trees_m > 0.0)
        objects += along(25.0, 1.0, [&](double at) { add_hedge(mesh_, frame(at, side * 9.5), 8.0, 1.4); });
    }
    // Identical posts at equal distances, on the right only.
    objects += along(plan_.posts_m, 0.0, [&](double at) { add_post(at); });
    return counted(objects, "objects along the road");
  }

 private:
  [[nodiscard]] SE3 frame(double at, double left, double yaw = 0.0) const {
    const double off = std::abs(left) - kRoadEdgeM;
    const Vector2 p = line_.place(at, left, 0.0).head<2>();
    return line_.frame(at, left, off > 0.0 ? std::min(1.0, off / 10.0) * relief_.at(p).height : 0.0, yaw);
  }

  void add_ground() {
    const Stretch whole{0.0, line_.length_m(), 2.0};
    add_strip(mesh_, line_, whole, {{-kRoadEdgeM, -0.05}, {0.0, 0.0}, {kRoadEdgeM, -0.05}},
              Material::kAsphalt);
    const Material beside = plan_.kind == SceneKind::kSquare || plan_.kind == SceneKind::kBridge
                                ? Material::kPavement
                                : Material::kGrass;
    for (const double side : {-1.0, 1.0}) {
      add_strip(
          mesh_, line_, whole,
          [&](double at) {
            Profile profile;
            for (const double share : {0.0, 0.02, 0.05, 0.1, 0.2, 0.35, 0.6, 1.0}) {
              const double left = side * (kRoadEdgeM + share * (plan_.ground_m - kRoadEdgeM));
              const Vector2 p = line_.place(at, left, 0.0).head<2>();
              const double rise = std::min(1.0, (std::abs(left) - kRoadEdgeM) / 10.0) * relief_.at(p).height;
              profile.emplace_back(left, rise - 0.05);
            }
            return profile;
          },
          beside);
    }
  }

  /// Calls `add` each `spacing_m`, varied by a share of it; the number of calls.
  template <class Add>
  std::size_t along(double spacing_m, double spread, const Add& add) {
    std::size_t count = 0;
    if (spacing_m <= 0.0 || config_.density <= 0.0) return count;
    const double spacing = spacing_m / config_.density;
    for (double at = spacing * random_.uniform(0.2, 0.8); at < line_.length_m() - 1.0;
         at += spacing * (1.0 + spread * random_.uniform(-0.5, 0.5)))
      add(at), ++count;
    return count;
  }

  void add_tree_at(double at, double side) {
    const double off = side * (plan_.tree_offset_m + 0.2 * random_.gaussian());
    add_tree(mesh_, frame(at, off, random_.uniform(0.0, 3.0)), random_.uniform(1.8, 2.6), random_);
  }

  void add_house(double at, double side) {
    const BuildingPlan plan = random_building_plan(random_.uniform(12.0, 24.0), 12.0, random_);
    const double yaw = side < 0.0 ? std::numbers::pi : 0.0;
    add_building(mesh_, frame(at, side * (plan_.house_offset_m + 0.5 * plan.depth_m), yaw), plan);
  }

  void add_post(double at) {
    const SE3 T_mesh_post = frame(at, -plan_.post_offset_m);
    mesh_.add_box(T_mesh_post, {-0.12, -0.12, -0.5}, {0.12, 0.12, 6.5}, Material::kMetal);
    mesh_.add_box(T_mesh_post, {-0.05, 0.0, 6.0}, {0.05, plan_.post_offset_m, 6.1}, Material::kMetal);
  }

  void add_railing(double side) {
    const Stretch whole{0.0, line_.length_m(), 4.0};
    for (const double up : {0.5, 1.0})
      add_strip(mesh_, line_, whole, {{side * 5.8, up}, {side * 5.8, up + 0.06}}, Material::kMetal);
    for (double at = 0.0; at < line_.length_m(); at += 2.0)
      mesh_.add_box(line_.frame(at, side * 5.8, 0.0), {-0.04, -0.04, -0.2}, {0.04, 0.04, 1.06},
                    Material::kMetal);
  }

  const RoadLine& line_;
  const RoadsidePlan& plan_;
  const SceneConfig& config_;
  TriangleMesh& mesh_;
  RandomStream random_;
  Relief relief_;
};

RoadSurface surface_of(const RoadsidePlan& plan, double length_m) {
  RoadSurface road;
  road.roughness_m3 = plan.roughness_m3;
  road.washboard_m = plan.washboard_m;
  for (double at = plan.joints_m; plan.joints_m > 0.0 && at < length_m; at += plan.joints_m)
    road.events.push_back({at, 0.15, -0.01});
  return road;
}

}  // namespace

core::Result<Scene> build_roadside(SceneKind kind, const SceneConfig& config) {
  const RoadsidePlan& plan = plan_of(kind);
  const double speed = *config.speed_m_s;
  const double setting_off_s = config.moving_start ? 0.0 : kStationaryTimeS + 0.5 * speed / 1.8;
  const double duration_s =
      wanted_duration(config.extent, speed, 60.0) + (config.extent.duration_s > 0.0 ? 0.0 : setting_off_s);
  const double drive_m = 1.02 * speed * duration_s + 5.0;
  if (drive_m > kLongestRoadM)
    return core::Error{"the road is at most 20 km long; take a shorter --duration or --length"};
  const double phase = RandomStream(config.seed, 290).uniform(0.0, 6.0);
  const RoadLine line = make_road_line(
      drive_m + 2.0 * kRoadBeyondM, [&](double at) { return plan.bends * std::sin(at / 70.0 + phase); },
      [&](double at) { return 400.0 * plan.relief * std::sin(at / 90.0 + phase); });
  std::vector<double> travelled;
  if (config.moving_start) {
    travelled = travel_at(kRoadBeyondM, speed, duration_s);
  } else {
    DrivingStyle style;
    style.cruise_speed_m_s = speed;
    travelled = arc_length_over_time(line.route, speed_profile(line.route, line.length_m(), style),
                                     line.length_m(), style);
    travelled.resize(
        std::min(travelled.size(), static_cast<std::size_t>(duration_s / kControlIntervalS) + 2));
    for (double& at : travelled) at += kRoadBeyondM;
  }
  Scene scene;
  scene.mesh.porous_plants = config.porous_plants;
  scene.poses = cut_drive(drive_over(line.route, travelled, config.sway_speed(),
                                     [&](double at, const Vector2&) { return line.ground(at); }),
                          kControlIntervalS, config.extent);
  scene.contents = RoadsideBuilder(line, plan, config, scene.mesh).build();
  scene.road = surface_of(plan, drive_m);
  return scene;
}

}  // namespace nilio::tools::simulate
