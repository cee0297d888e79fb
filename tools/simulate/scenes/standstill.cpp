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

constexpr double kRoadM = 300.0;
constexpr double kPlaceM = 150.0;
// Left of the parked vehicle.
constexpr double kStreetLaneM = 3.0;
constexpr double kOncomingM = 6.5;
constexpr double kKerbM = -1.2;
constexpr double kFarKerbM = 8.6;
constexpr double kUsualDurationS = 60.0;
/// Period of the bus; once in a shorter stay.
constexpr double kBusPeriodS = 600.0;

/// Time span for which the bus occupies the adjacent lane.
struct BusStop {
  double arrives_s = 0.0;
  double stands_s = 0.0;
};

std::vector<BusStop> bus_stops(double duration_s) {
  const double period = std::min(kBusPeriodS, duration_s);
  std::vector<BusStop> stops;
  for (double begin = 0.0; begin + 0.5 * period < duration_s; begin += period)
    stops.push_back({begin + 0.3 * period, 0.3 * period});
  return stops;
}

MovingCar make_bus(const RoadLine& line, const BusStop& stop) {
  constexpr double kSpeed = 9.0;
  MovingCar bus;
  bus.model = kBusModel;
  bus.path = line.path(kStreetLaneM, false);
  bus.speed_m_s = kSpeed;
  bus.halt_m = kPlaceM + 1.0;
  bus.halt_s = stop.stands_s;
  const double braking_s = kSpeed / kHaltAcceleration;
  bus.start_m = bus.halt_m - 0.5 * kSpeed * braking_s - kSpeed * (stop.arrives_s - braking_s);
  return bus;
}

std::vector<MovingCar> make_passing_traffic(const RoadLine& line, const SceneConfig& config,
                                            double duration_s) {
  RandomStream random(config.seed, 261);
  const std::vector<BusStop> stops = bus_stops(duration_s);
  std::vector<MovingCar> cars;
  cars.reserve(stops.size());
  for (const BusStop& stop : stops) cars.push_back(make_bus(line, stop));
  const auto blocked = [&](double time_s) {
    return std::any_of(stops.begin(), stops.end(), [&](const BusStop& stop) {
      return time_s > stop.arrives_s - 20.0 && time_s < stop.arrives_s + stop.stands_s + 25.0;
    });
  };
  for (const bool oncoming : {false, true}) {
    for (double t = random.uniform(0.0, 6.0); t < duration_s; t += random.uniform(3.0, 15.0)) {
      if (!oncoming && blocked(t)) continue;
      MovingCar car;
      car.model = random.chance(0.1) ? kTruckModel : random.index(kCarModels);
      car.path = line.path(oncoming ? kOncomingM : kStreetLaneM, oncoming);
      car.speed_m_s = 12.0;
      car.start_m = kPlaceM - car.speed_m_s * t;
      cars.push_back(std::move(car));
    }
  }
  if (config.moving_cars && cars.size() > *config.moving_cars) cars.resize(*config.moving_cars);
  return cars;
}

void add_street(TriangleMesh& mesh, const RoadLine& line) {
  const Stretch whole{0.0, line.length_m(), 2.0};
  add_strip(mesh, line, whole, {{kKerbM, 0.0}, {2.5, 0.05}, {5.0, 0.06}, {kFarKerbM, 0.0}},
            Material::kAsphalt);
  add_strip(mesh, line, whole, {{kKerbM, -0.1}, {kKerbM, 0.12}, {-4.0, 0.15}, {-30.0, 0.1}},
            Material::kPavement);
  add_strip(mesh, line, whole, {{kFarKerbM, -0.1}, {kFarKerbM, 0.12}, {12.0, 0.15}, {40.0, 0.1}},
            Material::kPavement);
}

std::string furnish(TriangleMesh& mesh, const RoadLine& line, const SceneConfig& config) {
  RandomStream random(config.seed, 262);
  std::size_t houses = 0;
  std::size_t parked = 0;
  std::size_t trees = 0;
  for (const double side : {-1.0, 1.0}) {
    for (double at = 10.0; at < kRoadM - 10.0; at += random.uniform(16.0, 30.0)) {
      const BuildingPlan plan = random_building_plan(random.uniform(10.0, 16.0), 10.0, random);
      const double off = random.uniform(4.0, 8.0) + 0.5 * plan.depth_m;
      if (!random.chance(std::min(1.0, 0.85 * config.density))) continue;
      const double left = side < 0.0 ? kKerbM - off : kFarKerbM + off;
      add_building(mesh, line.frame(at, left, 0.1, side < 0.0 ? std::numbers::pi : 0.0), plan);
      ++houses;
    }
    for (double at = 5.0; at < kRoadM; at += random.uniform(9.0, 20.0)) {
      if (!random.chance(std::min(1.0, 0.8 * config.density))) continue;
      const double left = side < 0.0 ? kKerbM - 1.0 : kFarKerbM + 1.0;
      const SE3 frame = line.frame(at, left, 0.1, -0.5 * side * std::numbers::pi);
      if (random.chance(0.5)) {
        add_tree(mesh, frame, random.uniform(1.0, 1.8), random);
        ++trees;
      } else {
        add_lamp(mesh, line.frame(at, left, 0.1, -side * 0.5 * std::numbers::pi), random);
      }
    }
  }
  for (double at = 20.0; at < kRoadM - 20.0; at += random.uniform(5.8, 9.0)) {
    if (std::abs(at - kPlaceM) < 6.0 || !random.chance(std::min(1.0, 0.75 * config.density))) continue;
    mesh.append(make_car(random.index(kCarModels)), line.frame(at, random.uniform(-0.15, 0.15), 0.0));
    ++parked;
  }
  return counted(houses, "houses, ") + counted(trees, "trees, ") + counted(parked, "parked cars");
}

}  // namespace

core::Result<Scene> build_standstill(const SceneConfig& config) {
  const double duration_s = config.extent.duration_s > 0.0 ? config.extent.duration_s : kUsualDurationS;
  const RoadLine line = make_road_line(
      kRoadM, [](double at) { return 0.05 * std::sin(at / 60.0); }, [](double at) { return 0.012 * at; });
  GroundSlope slope = line.ground(kPlaceM);
  // The camber of the road.
  const RoutePoint at = route_at(line.route, kPlaceM);
  slope.gradient += 0.015 * left_of(direction(at.heading));
  Scene scene;
  scene.mesh.porous_plants = config.porous_plants;
  const auto count = static_cast<std::size_t>(std::ceil(duration_s / kControlIntervalS)) + 1;
  scene.poses.assign(std::max<std::size_t>(count, 2), place_vehicle(at, slope, 0.0, 0.0, 0.0, 1.0));
  add_street(scene.mesh, line);
  scene.contents = furnish(scene.mesh, line, config);
  scene.cars = make_passing_traffic(line, config, duration_s);
  return scene;
}

}  // namespace nilio::tools::simulate
