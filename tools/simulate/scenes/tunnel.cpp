#include "tools/simulate/geometry/relief.hpp"
#include "tools/simulate/geometry/road_line.hpp"
#include "tools/simulate/scenes/scene.hpp"
#include "tools/simulate/town/street_objects.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

namespace nilio::tools::simulate {

namespace {

using core::SE3;
using core::Vector3;

constexpr double kTunnelM = 300.0;
/// Start of the drive; the road begins before it.
constexpr double kStartM = 120.0;
constexpr double kPortalM = 300.0;
constexpr double kFarPortalM = kPortalM + kTunnelM;
constexpr double kAfterM = 260.0;
/// Straight road before and after the tunnel.
constexpr double kStraightM = 40.0;
// Left of the driven lane.
constexpr double kRightWallM = -2.6;
constexpr double kLeftWallM = 5.9;
constexpr double kOncomingLaneM = 3.5;
constexpr double kWallM = 3.0;
constexpr double kVaultM = 2.8;
constexpr int kVaultFacets = 12;

/// Cross-section from the right foot of the wall over the vault to the left one.
Profile tube() {
  const double centre = 0.5 * (kRightWallM + kLeftWallM);
  const double radius = 0.5 * (kLeftWallM - kRightWallM);
  Profile profile{{kRightWallM, -0.1}};
  for (int i = 0; i <= kVaultFacets; ++i) {
    const double angle = std::numbers::pi * i / kVaultFacets;
    profile.emplace_back(centre - radius * std::cos(angle), kWallM + kVaultM * std::sin(angle));
  }
  profile.emplace_back(kLeftWallM, -0.1);
  return profile;
}

class TunnelBuilder {
 public:
  TunnelBuilder(const RoadLine& line, const SceneConfig& config, TriangleMesh& mesh)
      : line_(line),
        config_(config),
        mesh_(mesh),
        hills_(RandomStream(config.seed, 221), 30.0, 160.0, 0.01) {}

  std::string build() {
    add_strip(mesh_, line_, {0.0, line_.length_m(), 4.0}, {{kRightWallM, 0.0}, {kLeftWallM, 0.0}},
              Material::kAsphalt);
    add_strip(mesh_, line_, {kPortalM, kFarPortalM, 10.0}, tube(), Material::kPavement);
    add_portal(kPortalM, -1.0);
    add_portal(kFarPortalM, 1.0);
    if (config_.tunnel_lamps) add_fittings();
    add_open_road({0.0, kPortalM, 3.0}, 222);
    add_open_road({kFarPortalM, line_.length_m(), 3.0}, 223);
    return counted(houses_, "houses, ") + counted(plants_, "trees and bushes, ") +
           (config_.tunnel_lamps ? counted(fittings_, "lamps and niches in the tunnel") : "a bare tunnel");
  }

 private:
  /// `outwards`: sign of the direction out of the tunnel.
  void add_portal(double at_m, double outwards) {
    const Profile vault = tube();
    constexpr double kTopM = 8.5;
    for (std::size_t i = 0; i + 1 < vault.size(); ++i) {
      mesh_.add_quad(line_.place(at_m, vault[i].x(), vault[i].y()),
                     line_.place(at_m, vault[i + 1].x(), vault[i + 1].y()),
                     line_.place(at_m, vault[i + 1].x(), kTopM), line_.place(at_m, vault[i].x(), kTopM),
                     Material::kBrick);
    }
    for (const auto& [from, to] : {std::pair(kLeftWallM, 30.0), std::pair(-27.0, kRightWallM)}) {
      mesh_.add_quad(line_.place(at_m, from, -0.5), line_.place(at_m, to, -0.5), line_.place(at_m, to, kTopM),
                     line_.place(at_m, from, kTopM), Material::kBrick);
    }
    // Signals before the portal and a cabinet behind it.
    const double facing = outwards < 0.0 ? 0.0 : std::numbers::pi;
    for (const double left : {kRightWallM - 0.6, kLeftWallM + 0.6}) {
      mesh_.add_box(line_.frame(at_m + 12.0 * outwards, left, 0.0, facing), {-0.08, -0.08, -0.3},
                    {0.08, 0.08, 4.2}, Material::kMetal);
      mesh_.add_box(line_.frame(at_m + 12.0 * outwards, left, 0.0, facing), {-0.2, -0.35, 3.0},
                    {0.2, 0.35, 4.2}, Material::kMetal);
    }
    mesh_.add_box(line_.frame(at_m - 6.0 * outwards, kRightWallM + 0.2, 0.0), {-0.6, -0.2, 0.0},
                  {0.6, 0.2, 1.9}, Material::kMetal);
  }

  void add_fittings() {
    for (double at = kPortalM + 10.0; at < kFarPortalM; at += 12.0) {
      for (const double left : {-0.5, 3.8}) {
        mesh_.add_box(line_.frame(at, left, 5.0), {-0.7, -0.15, 0.0}, {0.7, 0.15, 0.25}, Material::kMetal);
        ++fittings_;
      }
    }
    for (double at = kPortalM + 40.0; at < kFarPortalM; at += 60.0) {
      mesh_.add_box(line_.frame(at, kRightWallM, 0.0), {-1.2, -0.05, 0.0}, {1.2, 0.3, 2.4}, Material::kMetal);
      ++fittings_;
    }
  }

  [[nodiscard]] double verge(double at_m, double left_m) const {
    const double off = std::max(kRightWallM - left_m, left_m - kLeftWallM);
    const Vector2 p = line_.place(at_m, left_m, 0.0).head<2>();
    return std::clamp(off / 12.0, 0.0, 1.0) * hills_.at(p).height - 0.05;
  }

  void add_open_road(const Stretch& stretch, std::uint64_t stream) {
    for (const double side : {-1.0, 1.0}) {
      add_strip(
          mesh_, line_, stretch,
          [&](double at) {
            const double edge = side < 0.0 ? kRightWallM : kLeftWallM;
            Profile profile{{edge, -0.1}};
            for (const double off : {1.0, 2.5, 5.0, 9.0, 14.0, 25.0, 40.0, 60.0})
              profile.emplace_back(edge + side * off, verge(at, edge + side * off));
            return profile;
          },
          Material::kGrass);
    }
    RandomStream random(config_.seed, stream);
    add_guard_rail(mesh_, line_, {stretch.from_m, stretch.to_m, 4.0}, kRightWallM - 0.5);
    for (const double side : {-1.0, 1.0}) add_houses(stretch, side, random);
    for (double at = stretch.from_m; at < stretch.to_m; at += random.uniform(4.0, 10.0))
      add_plant(at, random);
  }

  void add_houses(const Stretch& stretch, double side, RandomStream& random) {
    for (double at = stretch.from_m + 20.0; at < stretch.to_m - 20.0; at += random.uniform(25.0, 60.0)) {
      const BuildingPlan plan = random_building_plan(random.uniform(9.0, 18.0), 9.0, random);
      const double setback = random.uniform(6.0, 14.0) + 0.5 * plan.depth_m;
      if (!random.chance(std::min(1.0, 0.75 * config_.density))) continue;
      const double left = side < 0.0 ? kRightWallM - setback : kLeftWallM + setback;
      const double yaw = (side < 0.0 ? std::numbers::pi : 0.0) + 0.1 * random.gaussian();
      add_building(mesh_, line_.frame(at, left, verge(at, left), yaw), plan);
      ++houses_;
    }
  }

  void add_plant(double at_m, RandomStream& random) {
    const double off = random.uniform(2.0, 5.0);
    const double left = random.chance(0.5) ? kRightWallM - off : kLeftWallM + off;
    if (!random.chance(std::min(1.0, 0.7 * config_.density))) return;
    const SE3 frame = line_.frame(at_m, left, verge(at_m, left), random.uniform(0.0, 3.0));
    if (random.chance(0.4)) {
      add_tree(mesh_, frame, random.uniform(1.0, 1.9), random);
    } else {
      add_bush(mesh_, frame, random.uniform(0.5, 1.2), random);
    }
    ++plants_;
  }

  const RoadLine& line_;
  const SceneConfig& config_;
  TriangleMesh& mesh_;
  Relief hills_;
  std::size_t houses_ = 0;
  std::size_t plants_ = 0;
  std::size_t fittings_ = 0;
};

std::vector<MovingCar> make_oncoming(const RoadLine& line, const SceneConfig& config, double duration_s) {
  RandomStream random(config.seed, 224);
  const std::size_t count = config.moving_cars.value_or(static_cast<unsigned>(duration_s / 5.0));
  const std::vector<Vector3> path = line.path(kOncomingLaneM, true);
  std::vector<MovingCar> cars;
  constexpr double kSpeed = 18.0;
  double start = -60.0 + random.uniform(0.0, 60.0);
  for (std::size_t i = 0; i < count; ++i) {
    MovingCar car;
    car.model = random.chance(0.15) ? kTruckModel : random.index(kCarModels);
    car.path = path;
    car.speed_m_s = kSpeed;
    car.start_m = start;
    start -= random.uniform(50.0, 130.0);
    cars.push_back(std::move(car));
  }
  return cars;
}

}  // namespace

core::Result<Scene> build_tunnel(const SceneConfig& config) {
  const double speed = *config.speed_m_s;
  const double longest_m = kFarPortalM + kAfterM - kStartM;
  const double duration_s =
      std::min(wanted_duration(config.extent, speed, longest_m / speed), longest_m / (1.02 * speed));
  const double phase = RandomStream(config.seed, 220).uniform(0.0, 6.0);
  const auto bend = [&](double at) {
    const double outside = std::max({0.0, kPortalM - kStraightM - at, at - kFarPortalM - kStraightM});
    return 0.15 * std::sin(outside / 60.0) * std::min(1.0, outside / 40.0);
  };
  const auto rise = [&](double at) {
    const double outside = std::max({0.0, kPortalM - kStraightM - at, at - kFarPortalM - kStraightM});
    return std::min(1.0, outside / 60.0) * std::sin(outside / 50.0 + phase);
  };
  const RoadLine line = make_road_line(kFarPortalM + kAfterM + 150.0, bend, rise);
  Scene scene;
  scene.mesh.porous_plants = config.porous_plants;
  const std::vector<double> travelled = travel_at(kStartM, speed, duration_s);
  scene.poses = cut_drive(drive_over(line.route, travelled, config.sway_speed(),
                                     [&](double at, const Vector2&) { return line.ground(at); }),
                          kControlIntervalS, config.extent);
  scene.contents = TunnelBuilder(line, config, scene.mesh).build();
  scene.cars = make_oncoming(line, config, duration_s);
  return scene;
}

}  // namespace nilio::tools::simulate
