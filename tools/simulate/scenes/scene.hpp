#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/se3.hpp"

#include "tools/simulate/geometry/mesh.hpp"
#include "tools/simulate/scenes/traffic.hpp"
#include "tools/simulate/vehicle/road_surface.hpp"
#include "tools/simulate/vehicle/vehicle_trajectory.hpp"

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace nilio::tools::simulate {

/// Scene of a simulated drive.
enum class SceneKind : std::uint8_t {
  kTown,
  kHighway,     ///< three lanes each way, dense traffic, few static objects
  kTunnel,      ///< 300 m of bare tube between open roads
  kRamps,       ///< up a multi-storey car park
  kForest,      ///< a track among trunks and bushes on uneven ground
  kStandstill,  ///< parked beside a road with traffic
  kManoeuvres,  ///< the town with 1 g of braking and corners at 90 deg/s
  kQueue,       ///< stop and go in dense traffic, trucks on both sides
  // The town along a drive of its own.
  kStopAndGo,
  kRoundabout,
  kReversing,
  kUTurn,
  kThreePointTurn,
  kHillHold,
  // Along one road.
  kAvenue,
  kField,
  kBridge,
  kSquare,
  kRailway,
  kWashboard,
  kGarage,  ///< one low storey of a car park
  kFerry,   ///< on the deck of a ship: LiDAR and IMU disagree
};

struct SceneConfig {
  std::uint64_t seed = 1;
  DriveExtent extent;
  /// Unset = the scene's own.
  std::optional<double> speed_m_s;
  bool moving_start = false;
  /// Scales the number of static objects.
  double density = 1.0;
  /// Unset = the scene's own.
  std::optional<unsigned> moving_cars;
  bool tunnel_lamps = false;
  /// Plants that light enters.
  bool porous_plants = false;
  /// Hedges, fences, wires and small objects.
  bool clutter = false;
  /// Whether the body's own motion is added later, on RoadSurface; otherwise it sways smoothly.
  bool steady_body = false;

  /// Cruising speed for the body's smooth sway in drive_over().
  [[nodiscard]] double sway_speed() const;
};

/// Poses of a drive, and the geometry around it.
struct Scene {
  /// Every kControlIntervalS.
  std::vector<core::SE3> poses;
  /// Poses as the IMU senses them, where the ground itself moves; empty = `poses`.
  std::vector<core::SE3> inertial_poses;
  TriangleMesh mesh;
  std::vector<MovingCar> cars;
  RoadSurface road;
  /// Summary for people: "12 bridges, 300 trees".
  std::string contents;
};

struct SceneInfo {
  SceneKind kind;
  const char* name;
  /// One-line description for --help.
  const char* summary;
  /// 0 = stationary.
  double speed_m_s;
  /// Whether the drive may begin stationary: false for the tunnel.
  bool may_start_stationary;
};
/// In the order of the help text.
const std::vector<SceneInfo>& scene_infos();
const SceneInfo& info_of(SceneKind kind);
/// Whether the scene is the town, built around its drive.
bool is_town(SceneKind kind);

/// Builds a scene other than the town's, which are built around their drive. The same configuration gives the
/// same scene. Fails when the drive is too long for the scene.
core::Result<Scene> build_scene(SceneKind kind, const SceneConfig& config);

// The scenes; the speed has to be set.
core::Result<Scene> build_highway(const SceneConfig& config);
core::Result<Scene> build_queue(const SceneConfig& config);
/// Avenue, field, bridge, square, railway or washboard.
core::Result<Scene> build_roadside(SceneKind kind, const SceneConfig& config);
core::Result<Scene> build_garage(const SceneConfig& config);
core::Result<Scene> build_ferry(const SceneConfig& config);
core::Result<Scene> build_tunnel(const SceneConfig& config);
core::Result<Scene> build_ramps(const SceneConfig& config);
core::Result<Scene> build_forest(const SceneConfig& config);
core::Result<Scene> build_standstill(const SceneConfig& config);

/// Potholes, a pair of them each 60 m, and low speed bumps each 300 m along a drive.
RoadSurface town_road(double length_m, std::uint64_t seed);

/// Duration of a drive at `speed_m_s`; `usual_s` if the extent has no limit.
double wanted_duration(const DriveExtent& extent, double speed_m_s, double usual_s);

/// "3 trees", for Scene::contents.
std::string counted(std::size_t count, const char* things);

}  // namespace nilio::tools::simulate
