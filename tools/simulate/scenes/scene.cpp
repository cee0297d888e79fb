#include "tools/simulate/scenes/scene.hpp"

#include "tools/simulate/random.hpp"

#include <algorithm>
#include <limits>

namespace nilio::tools::simulate {

const std::vector<SceneInfo>& scene_infos() {
  static const std::vector<SceneInfo> infos{
      {SceneKind::kTown, "town", "streets with houses, trees, parked cars and traffic", 10.0, true},
      {SceneKind::kHighway, "highway", "30 m/s among cars and trucks, few static objects", 30.0, true},
      {SceneKind::kTunnel, "tunnel", "300 m of bare tube between open roads", 20.0, false},
      {SceneKind::kRamps, "ramps", "up four storeys of a car park", 5.0, true},
      {SceneKind::kForest, "forest", "trunks and bushes along an uneven track", 6.0, true},
      {SceneKind::kStandstill, "standstill", "parked beside a road, a bus stops beside the car", 0.0, true},
      {SceneKind::kManoeuvres, "manoeuvres", "the town with 1 g of braking and corners at 90 deg/s", 14.0,
       true},
      {SceneKind::kQueue, "queue", "stop and go on a motorway, trucks on both sides", 6.0, true},
      {SceneKind::kStopAndGo, "stop_and_go", "a stop every 16 m in the town", 7.0, true},
      {SceneKind::kRoundabout, "roundabout", "twice round a small roundabout in the town", 8.0, true},
      {SceneKind::kReversing, "reversing", "backwards round a corner", 7.0, true},
      {SceneKind::kUTurn, "u_turn", "back on the other side of the street", 8.0, true},
      {SceneKind::kThreePointTurn, "three_point_turn", "forwards, backwards, forwards", 8.0, true},
      {SceneKind::kHillHold, "hill_hold", "halts on a slope of 12 %, rolls back", 7.0, true},
      {SceneKind::kAvenue, "avenue", "a straight avenue between two rows of trees", 12.0, true},
      {SceneKind::kField, "field", "a road through fields: grass, few bushes and posts", 15.0, true},
      {SceneKind::kBridge, "bridge", "a long bridge: deck, railings, equal posts", 20.0, true},
      {SceneKind::kSquare, "square", "a wide square, houses 75 m away", 6.0, true},
      {SceneKind::kRailway, "railway", "a straight line with identical posts every 50 m", 25.0, true},
      {SceneKind::kWashboard, "washboard", "a corrugated track", 8.0, true},
      {SceneKind::kGarage, "garage", "twice round a low underground car park", 4.0, true},
      {SceneKind::kFerry, "ferry", "parked on a ship: the IMU senses the sea", 0.0, true},
  };
  return infos;
}

const SceneInfo& info_of(SceneKind kind) {
  const auto& infos = scene_infos();
  return *std::find_if(infos.begin(), infos.end(), [&](const SceneInfo& info) { return info.kind == kind; });
}

bool is_town(SceneKind kind) {
  using enum SceneKind;
  return kind == kTown || kind == kManoeuvres || (kind >= kStopAndGo && kind <= kHillHold);
}

core::Result<Scene> build_scene(SceneKind kind, const SceneConfig& given) {
  SceneConfig config = given;
  config.speed_m_s = given.speed_m_s.value_or(info_of(kind).speed_m_s);
  switch (kind) {
    case SceneKind::kHighway:
      return build_highway(config);
    case SceneKind::kTunnel:
      return build_tunnel(config);
    case SceneKind::kRamps:
      return build_ramps(config);
    case SceneKind::kForest:
      return build_forest(config);
    case SceneKind::kStandstill:
      return build_standstill(config);
    case SceneKind::kQueue:
      return build_queue(config);
    case SceneKind::kAvenue:
    case SceneKind::kField:
    case SceneKind::kBridge:
    case SceneKind::kSquare:
    case SceneKind::kRailway:
    case SceneKind::kWashboard:
      return build_roadside(kind, config);
    case SceneKind::kGarage:
      return build_garage(config);
    case SceneKind::kFerry:
      return build_ferry(config);
    default:
      break;
  }
  return core::Error{std::string(info_of(kind).name) + ": is built around its drive by build_town()"};
}

double SceneConfig::sway_speed() const {
  const bool stationary = *speed_m_s == 0.0;
  return steady_body || stationary ? std::numeric_limits<double>::infinity() : *speed_m_s;
}

RoadSurface town_road(double length_m, std::uint64_t seed) {
  RandomStream random(seed, 64);
  RoadSurface road;
  for (double at = random.uniform(10.0, 60.0); at < length_m; at += random.uniform(20.0, 100.0))
    road.events.push_back({at, random.uniform(0.3, 0.8), -random.uniform(0.01, 0.03)});
  for (double at = random.uniform(60.0, 200.0); at < length_m; at += random.uniform(200.0, 400.0))
    road.events.push_back({at, 4.0, 0.04});
  return road;
}

double wanted_duration(const DriveExtent& extent, double speed_m_s, double usual_s) {
  if (extent.length_m <= 0.0 && extent.duration_s <= 0.0) return usual_s;
  const double unlimited = std::numeric_limits<double>::max();
  return std::min(extent.duration_s > 0.0 ? extent.duration_s : unlimited,
                  extent.length_m > 0.0 ? extent.length_m / speed_m_s + 1.0 : unlimited);
}

std::string counted(std::size_t count, const char* things) { return std::to_string(count) + " " + things; }

}  // namespace nilio::tools::simulate
