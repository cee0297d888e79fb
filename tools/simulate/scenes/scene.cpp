#include "tools/simulate/scenes/scene.hpp"

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
  };
  return infos;
}

const SceneInfo& info_of(SceneKind kind) {
  const auto& infos = scene_infos();
  return *std::find_if(infos.begin(), infos.end(), [&](const SceneInfo& info) { return info.kind == kind; });
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
    case SceneKind::kTown:
    case SceneKind::kManoeuvres:
      break;
  }
  return core::Error{std::string(info_of(kind).name) + ": is built around its drive by build_town()"};
}

double wanted_duration(const DriveExtent& extent, double speed_m_s, double usual_s) {
  if (extent.length_m <= 0.0 && extent.duration_s <= 0.0) return usual_s;
  const double unlimited = std::numeric_limits<double>::max();
  return std::min(extent.duration_s > 0.0 ? extent.duration_s : unlimited,
                  extent.length_m > 0.0 ? extent.length_m / speed_m_s + 1.0 : unlimited);
}

std::string counted(std::size_t count, const char* things) { return std::to_string(count) + " " + things; }

}  // namespace nilio::tools::simulate
