#include "tools/simulate/geometry/scripted_drive.hpp"
#include "tools/simulate/scenes/scene.hpp"
#include "tools/simulate/town/street_objects.hpp"

#include <cmath>
#include <numbers>

namespace nilio::tools::simulate {

namespace {

using core::SE3;

constexpr double kCeilingM = 2.6;
constexpr double kHalfAisleM = 3.2;
constexpr double kBayM = 5.2;
constexpr double kColumnsM = 8.0;
// The hall; the drive is a loop around its middle block.
constexpr double kWestM = -15.0;
constexpr double kEastM = 75.0;
constexpr double kSouthM = -kHalfAisleM - kBayM;
constexpr double kNorthM = 34.0;

DrivePiece corner() { return {0.5 * std::numbers::pi * 5.0, 1.0 / 5.0}; }

}  // namespace

core::Result<Scene> build_garage(const SceneConfig& config) {
  DriveMove loop;
  loop.speed_m_s = *config.speed_m_s;
  for (int lap = 0; lap < 2; ++lap) {
    loop.pieces.insert(
        loop.pieces.end(),
        {{60.0, 0.0}, corner(), {15.6, 0.0}, corner(), {60.0, 0.0}, corner(), {15.6, 0.0}, corner()});
  }
  Scene scene;
  scene.poses =
      cut_drive(scripted_drive({loop}, config.sway_speed(), [](const Vector2&) { return GroundSlope{}; }),
                kControlIntervalS, config.extent);
  RandomStream random(config.seed, 295);
  TriangleMesh& mesh = scene.mesh;
  const auto box = [&](double x0, double x1, double y0, double y1, double z0, double z1, Material material) {
    mesh.add_box({}, {x0, y0, z0}, {x1, y1, z1}, material);
  };
  box(kWestM, kEastM, kSouthM, kNorthM, -0.3, 0.0, Material::kPavement);
  box(kWestM, kEastM, kSouthM, kNorthM, kCeilingM, kCeilingM + 0.3, Material::kPavement);
  for (const double y : {kSouthM, kNorthM})
    box(kWestM, kEastM, y - 0.1, y + 0.1, 0.0, kCeilingM, Material::kPavement);
  for (const double x : {kWestM, kEastM})
    box(x - 0.1, x + 0.1, kSouthM, kNorthM, 0.0, kCeilingM, Material::kPavement);
  std::size_t columns = 0;
  std::size_t cars = 0;
  for (double x = 6.0; x < 58.0; x += kColumnsM) {
    for (const double y : {kHalfAisleM + 1.2, 12.8, 25.6 - kHalfAisleM - 1.2}) {
      box(x - 0.25, x + 0.25, y - 0.25, y + 0.25, 0.0, kCeilingM, Material::kPavement);
      ++columns;
    }
    box(x - 0.2, x + 0.2, kSouthM, kNorthM, kCeilingM - 0.35, kCeilingM, Material::kPavement);
  }
  for (const double y :
       {-kHalfAisleM - 2.6, kHalfAisleM + 2.8, 25.6 - kHalfAisleM - 2.8, 25.6 + kHalfAisleM + 2.4}) {
    for (double x = 5.0; x < 58.0; x += 2.7) {
      const std::size_t model = random.index(3);
      const double yaw = (random.chance(0.5) ? 0.5 : -0.5) * std::numbers::pi + 0.03 * random.gaussian();
      if (std::abs(std::remainder(x - 6.0, kColumnsM)) < 1.3 ||
          !random.chance(std::min(1.0, 0.65 * config.density)))
        continue;
      mesh.append(make_car(model), upright_frame({x, y, 0.0}, yaw));
      ++cars;
    }
  }
  scene.contents = counted(columns, "columns, ") + counted(cars, "parked cars");
  return scene;
}

core::Result<Scene> build_ferry(const SceneConfig& config) {
  // Parked on the deck of a ship that rolls, pitches, heaves and turns: LiDAR sees the ship, the IMU the sea.
  SceneConfig parked = config;
  core::Result<Scene> scene = build_garage(parked);
  if (!scene) return scene;
  const double duration_s = wanted_duration(config.extent, 1.0, 60.0);
  const SE3 place = scene->poses.front();
  const auto count = static_cast<std::size_t>(std::ceil(duration_s / kControlIntervalS)) + 1;
  scene->poses.assign(std::max<std::size_t>(count, 2), place);
  RandomStream random(config.seed, 296);
  const double phase = random.uniform(0.0, 6.0);
  for (std::size_t i = 0; i < scene->poses.size(); ++i) {
    const double t = static_cast<double>(i) * kControlIntervalS;
    const double begin = std::min(1.0, t / 10.0);
    const core::Vector3 turn(begin * 0.035 * std::sin(2.0 * std::numbers::pi * t / 11.0 + phase),
                             begin * 0.015 * std::sin(2.0 * std::numbers::pi * t / 7.0 + phase),
                             0.009 * (t - 10.0 * (1.0 - std::exp(-0.1 * t))));
    const core::Vector3 place_at_sea(0.02 * begin * t * t, 0.0,
                                     begin * 0.5 * std::sin(2.0 * std::numbers::pi * t / 9.0));
    scene->inertial_poses.push_back(SE3{core::so3_exp(turn), place_at_sea} * place);
  }
  scene->contents += ", on a ship at sea";
  return scene;
}

}  // namespace nilio::tools::simulate
