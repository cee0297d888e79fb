#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/se3.hpp"

#include "tools/simulate/geometry/mesh.hpp"
#include "tools/simulate/scenes/traffic.hpp"
#include "tools/simulate/vehicle/vehicle_trajectory.hpp"

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace nilio::tools::simulate {

/// Where a simulated drive takes place.
enum class SceneKind : std::uint8_t {
  kTown,
  kHighway,     ///< three lanes each way, much traffic, few things that stand
  kTunnel,      ///< 300 m of bare tube between open roads
  kRamps,       ///< up a multi-storey car park
  kForest,      ///< a track among trunks and bushes on uneven ground
  kStandstill,  ///< parked beside a road with traffic
  kManoeuvres,  ///< the town with 1 g of braking and corners at 90 deg/s
};

struct SceneConfig {
  std::uint64_t seed = 1;
  DriveExtent extent;
  /// Nothing: as is usual there.
  std::optional<double> speed_m_s;
  bool moving_start = false;
  /// Scales how much stands there.
  double density = 1.0;
  /// Nothing: as is usual there.
  std::optional<unsigned> moving_cars;
  bool tunnel_lamps = false;
};

/// A drive and everything around it.
struct Scene {
  /// Every kControlIntervalS.
  std::vector<core::SE3> poses;
  TriangleMesh mesh;
  std::vector<MovingCar> cars;
  /// What there is, for people: "12 bridges, 300 trees".
  std::string contents;
};

struct SceneInfo {
  SceneKind kind;
  const char* name;
  /// What makes it hard.
  const char* summary;
  /// 0 = the vehicle stands.
  double speed_m_s;
  /// Whether the drive may begin standing: not just before a tunnel.
  bool standing_start;
};
/// In the order in which help names them.
const std::vector<SceneInfo>& scene_infos();
const SceneInfo& info_of(SceneKind kind);

/// Builds any scene but those in the town, which are built around their drive. The same configuration gives
/// the same scene. An error when the drive is too long for it.
core::Result<Scene> build_scene(SceneKind kind, const SceneConfig& config);

// One each; speed is set.
core::Result<Scene> build_highway(const SceneConfig& config);
core::Result<Scene> build_tunnel(const SceneConfig& config);
core::Result<Scene> build_ramps(const SceneConfig& config);
core::Result<Scene> build_forest(const SceneConfig& config);
core::Result<Scene> build_standstill(const SceneConfig& config);

/// How long a drive at `speed_m_s` lasts, `usual_s` if the extent does not say.
double wanted_duration(const DriveExtent& extent, double speed_m_s, double usual_s);

/// "3 trees" for the texts above.
std::string counted(std::size_t count, const char* things);

}  // namespace nilio::tools::simulate
