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

constexpr double kSightM = 45.0;
constexpr double kTrackHalfWidthM = 2.0;
constexpr double kLongestTrackM = 5000.0;

/// Hills, humps of the track, and roots and tussocks beside it.
struct ForestGround {
  Relief hills;
  Relief humps;
  Relief roots;

  explicit ForestGround(std::uint64_t seed)
      : hills(RandomStream(seed, 241), 40.0, 150.0, 0.01),
        humps(RandomStream(seed, 242), 7.0, 18.0, 0.004),
        roots(RandomStream(seed, 243), 1.5, 4.0, 0.02) {}

  [[nodiscard]] GroundSlope at(const Vector2& p) const {
    GroundSlope slope = hills.at(p);
    const GroundSlope rough = humps.at(p);
    slope.height += rough.height;
    slope.gradient += rough.gradient;
    return slope;
  }
};

/// Distance of a point to the track.
class TrackDistance {
 public:
  explicit TrackDistance(const std::vector<Vector2>& track) : track_(track) {}
  /// Metres, at most `limit_m`; searched around track point `around`.
  [[nodiscard]] double operator()(const Vector2& p, std::size_t around, double limit_m) const {
    double nearest = limit_m * limit_m;
    const auto reach = static_cast<std::size_t>(2.0 * kSightM / kRouteStepM);
    const std::size_t first = around > reach ? around - reach : 0;
    for (std::size_t i = first; i < std::min(track_.size(), around + reach); i += 2)
      nearest = std::min(nearest, (track_[i] - p).squaredNorm());
    return std::sqrt(nearest);
  }

 private:
  const std::vector<Vector2>& track_;
};

void add_trunk(TriangleMesh& mesh, const SE3& T_mesh_tree, RandomStream& random) {
  SE3 leaning = T_mesh_tree;
  leaning.rotation = leaning.rotation * Eigen::AngleAxisd(0.04 * random.gaussian(), Vector3::UnitX()) *
                     Eigen::AngleAxisd(0.04 * random.gaussian(), Vector3::UnitY());
  const double radius = random.uniform(0.08, 0.35);
  mesh.add_column(leaning, radius, -0.5, random.uniform(9.0, 16.0), Material::kBark);
  if (mesh.porous_plants) {
    constexpr std::uint64_t kDraws = 70 * 12;
    random.skip(kDraws);
    PorousVolume branches;
    branches.half_size = {1.3F, 1.3F, 2.5F};
    branches.extinction = 0.05F;
    mesh.add_volume(T_mesh_tree, {0.0, 0.0, 3.8}, branches);
    PorousVolume crown;
    crown.half_size = {2.6F, 2.6F, 4.0F};
    mesh.add_volume(T_mesh_tree, {0.0, 0.0, 10.0}, crown);
    return;
  }
  // Dead branches at head height, crowns above.
  for (int i = 0; i < 70; ++i) {
    const double up = i < 12 ? random.uniform(1.5, 6.0) : random.uniform(6.0, 14.0);
    const double out = i < 12 ? random.uniform(0.2, 1.2) : random.uniform(0.2, 2.6);
    const double turn = random.uniform(0.0, 2.0 * std::numbers::pi);
    const Vector3 centre(out * std::cos(turn), out * std::sin(turn), up);
    const auto corner = [&] {
      return leaning * (centre + 0.3 * Vector3(random.uniform(-1.0, 1.0), random.uniform(-1.0, 1.0),
                                               random.uniform(-1.0, 1.0)));
    };
    const Vector3 a = corner();
    const Vector3 b = corner();
    mesh.add_triangle(a, b, corner(), Material::kFoliage);
  }
}

/// Adds trunks, bushes and logs beside the track; returns their summary.
std::string plant_forest(const RoadLine& line, const ForestGround& ground, const SceneConfig& config,
                         TriangleMesh& mesh) {
  RandomStream random(config.seed, 244);
  const TrackDistance to_track(line.route.points);
  std::size_t trunks = 0;
  std::size_t bushes = 0;
  std::size_t logs = 0;
  const double per_metre = 4.5 * config.density;
  for (double at = 0.0; at < line.length_m(); at += 1.0 / std::max(per_metre, 0.01)) {
    const double left = random.uniform(-kSightM, kSightM);
    const Vector2 p = line.place(at, left, 0.0).head<2>();
    const double kind = random.uniform(0.0, 1.0);
    const double turn = random.uniform(0.0, std::numbers::pi);
    if (to_track(p, static_cast<std::size_t>(at / kRouteStepM), kTrackHalfWidthM + 2.0) <
        kTrackHalfWidthM + (kind < 0.45 ? 0.4 : 1.1))
      continue;
    const SE3 frame = upright_frame({p.x(), p.y(), ground.at(p).height}, turn);
    if (kind < 0.45) {
      add_trunk(mesh, frame, random);
      ++trunks;
    } else if (kind < 0.97) {
      add_bush(mesh, frame, random.uniform(0.3, 1.1), random);
      ++bushes;
    } else if (std::abs(left) > 8.0) {
      mesh.add_box(frame, {-2.5, -0.2, -0.1}, {2.5, 0.2, 0.35}, Material::kBark);
      ++logs;
    }
  }
  return counted(trunks, "trunks, ") + counted(bushes, "bushes, ") + counted(logs, "logs");
}

/// Length of the route for the requested extent.
double wanted_length(const SceneConfig& config) {
  if (config.extent.length_m > 0.0) return config.extent.length_m;
  return config.extent.duration_s > 0.0 ? config.extent.duration_s * *config.speed_m_s + 10.0 : 350.0;
}

}  // namespace

core::Result<Scene> build_forest(const SceneConfig& config) {
  const double stop_m = wanted_length(config);
  if (stop_m > kLongestTrackM)
    return core::Error{"the forest is at most 5 km long; take a shorter --duration or --length"};
  const double phase = RandomStream(config.seed, 240).uniform(0.0, 6.0);
  const RoadLine line = make_road_line(
      stop_m + 20.0,
      [&](double at) { return 0.8 * std::sin(at / 24.0 + phase) + 0.35 * std::sin(at / 10.5); },
      [](double) { return 0.0; });
  DrivingStyle style;
  style.cruise_speed_m_s = *config.speed_m_s;
  style.moving_start = config.moving_start;
  const std::vector<double> travelled =
      arc_length_over_time(line.route, speed_profile(line.route, stop_m, style), stop_m, style);
  const ForestGround ground(config.seed);
  Scene scene;
  scene.mesh.porous_plants = config.porous_plants;
  scene.poses = cut_drive(drive_over(line.route, travelled, config.sway_speed(),
                                     [&](double, const Vector2& p) { return ground.at(p); }),
                          kControlIntervalS, config.extent);
  HeightField field;
  field.reach_m = kSightM;
  field.cell_m = 0.75;
  field.height = [&](const Vector2& p) { return ground.at(p).height + ground.roots.at(p).height; };
  field.material = [](const Vector2&) { return Material::kGrass; };
  add_height_field(scene.mesh, line.route.points, field);
  scene.road.roughness_m3 = 1024e-6;
  scene.contents = plant_forest(line, ground, config, scene.mesh);
  return scene;
}

}  // namespace nilio::tools::simulate
