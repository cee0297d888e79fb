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

constexpr double kLaneM = 3.75;
// The vehicle drives in the middle of three lanes; the following are offsets to the left of it.
constexpr double kShoulderEdgeM = -8.2;
constexpr double kMedianM = 6.0;
constexpr double kFarMedianM = 9.2;
constexpr double kFarEdgeM = 23.4;
/// Road before and after the drive: the range of a LiDAR.
constexpr double kBeyondM = 250.0;
constexpr double kLongestM = 40000.0;
/// No cars beside the vehicle within this distance at the start: with only vehicles of equal speed in view,
/// no estimator could observe its own speed.
constexpr double kStartGapM = 70.0;

struct HighwayCounts {
  std::size_t bridges = 0;
  std::size_t gantries = 0;
  std::size_t signs = 0;
  std::size_t plants = 0;
  std::size_t buildings = 0;
};

class HighwayBuilder {
 public:
  HighwayBuilder(const RoadLine& line, const SceneConfig& config, TriangleMesh& mesh)
      : line_(line),
        config_(config),
        mesh_(mesh),
        hills_(RandomStream(config.seed, 201), 60.0, 250.0, 0.012),
        bumps_(RandomStream(config.seed, 202), 4.0, 20.0, 0.006) {}

  HighwayCounts build() {
    add_road();
    add_barriers();
    add_posts_and_signs();
    add_gantries();
    add_bridges();
    add_plants();
    add_buildings();
    return counts_;
  }

 private:
  [[nodiscard]] Stretch whole(double step_m) const { return {0.0, line_.length_m(), step_m}; }

  /// Height of the ground beside the road, relative to the road.
  [[nodiscard]] double verge(double at_m, double left_m) const {
    const double off = left_m < 0.0 ? kShoulderEdgeM - left_m : left_m - kFarEdgeM;
    const Vector2 p = line_.place(at_m, left_m, 0.0).head<2>();
    const double rise = std::clamp(off / 18.0, 0.0, 1.0);
    return rise * hills_.at(p).height + std::clamp(off / 3.0, 0.0, 1.0) * bumps_.at(p).height - 0.05;
  }

  void add_road() {
    const double camber = 0.02;
    add_strip(mesh_, line_, whole(5.0),
              {{kShoulderEdgeM, camber * kShoulderEdgeM}, {0.0, 0.0}, {kMedianM, -camber * kMedianM}},
              Material::kAsphalt);
    add_strip(mesh_, line_, whole(5.0), {{kFarMedianM, -0.12}, {16.0, 0.0}, {kFarEdgeM, -0.15}},
              Material::kAsphalt);
    add_strip(
        mesh_, line_, whole(2.0),
        [&](double at) {
          const Vector2 p = line_.place(at, 7.5, 0.0).head<2>();
          const double up = 0.15 + bumps_.at(p).height;
          return Profile{{kMedianM, -0.12}, {6.6, up}, {8.6, up}, {kFarMedianM, -0.12}};
        },
        Material::kGrass);
    for (const double side : {-1.0, 1.0}) {
      add_strip(
          mesh_, line_, whole(2.0),
          [&](double at) {
            Profile profile{{side < 0.0 ? kShoulderEdgeM : kFarEdgeM, -0.16}};
            for (const double off : {1.5, 3.0, 5.0, 8.0, 12.0, 18.0, 25.0, 35.0, 50.0, 75.0}) {
              const double left = side < 0.0 ? kShoulderEdgeM - off : kFarEdgeM + off;
              profile.emplace_back(left, verge(at, left));
            }
            return profile;
          },
          Material::kGrass);
    }
  }

  void add_barriers() {
    add_guard_rail(mesh_, line_, whole(4.0), kMedianM + 0.4);
    add_guard_rail(mesh_, line_, whole(4.0), kFarMedianM - 0.4);
    RandomStream random(config_.seed, 203);
    for (const double left : {kShoulderEdgeM - 0.5, kFarEdgeM + 0.5}) {
      for (double at = random.uniform(0.0, 100.0); at < line_.length_m();) {
        const double end = std::min(at + random.uniform(80.0, 300.0), line_.length_m());
        add_guard_rail(mesh_, line_, {at, end, 4.0}, left);
        if (random.chance(0.3 * std::min(1.0, config_.density))) add_noise_barrier(at, end, left);
        at = end + random.uniform(60.0, 300.0);
      }
    }
  }

  void add_noise_barrier(double from_m, double to_m, double rail_left_m) {
    const double left = rail_left_m < 0.0 ? rail_left_m - 1.5 : rail_left_m + 1.5;
    add_strip(mesh_, line_, {from_m, to_m, 4.0}, {{left, -0.5}, {left, 3.2}}, Material::kPavement);
    for (double at = from_m; at <= to_m; at += 4.0) {
      mesh_.add_box(line_.frame(at, left, 0.0), {-0.12, -0.15, -0.5}, {0.12, 0.15, 3.4}, Material::kMetal);
    }
  }

  void add_posts_and_signs() {
    RandomStream random(config_.seed, 204);
    for (double at = 10.0; at < line_.length_m(); at += 50.0) {
      for (const double left : {kShoulderEdgeM - 0.9, kFarEdgeM + 0.9}) {
        mesh_.add_box(line_.frame(at, left, 0.0), {-0.06, -0.06, -0.3}, {0.06, 0.06, 1.0},
                      Material::kPlaster);
      }
    }
    for (double at = random.uniform(20.0, 120.0); at < line_.length_m(); at += random.uniform(80.0, 220.0)) {
      if (!random.chance(std::min(1.0, config_.density))) continue;
      const bool right = random.chance(0.6);
      const double left = right ? kShoulderEdgeM - 2.2 : kFarEdgeM + 2.2;
      add_sign(mesh_, line_.frame(at, left, verge(at, left), right ? 0.0 : std::numbers::pi), random);
      ++counts_.signs;
    }
  }

  void add_gantries() {
    RandomStream random(config_.seed, 205);
    for (double at = random.uniform(100.0, 300.0); at < line_.length_m();
         at += random.uniform(350.0, 600.0)) {
      const double right = kShoulderEdgeM - 1.2;
      const double left = 0.5 * (kMedianM + kFarMedianM);
      for (const double post : {right, left}) {
        mesh_.add_box(line_.frame(at, post, 0.0), {-0.2, -0.2, -0.5}, {0.2, 0.2, 7.0}, Material::kMetal);
      }
      mesh_.add_box(line_.frame(at, 0.0, 0.0), {-0.3, right, 6.4}, {0.3, left, 7.2}, Material::kMetal);
      mesh_.add_box(line_.frame(at, 0.0, 0.0), {-0.5, -3.0, 5.6}, {-0.35, 3.0, 8.4},
                    Material::kRetroreflector);
      ++counts_.gantries;
    }
  }

  void add_bridges() {
    RandomStream random(config_.seed, 206);
    for (double at = random.uniform(250.0, 500.0); at < line_.length_m();
         at += random.uniform(500.0, 900.0)) {
      const double half = random.uniform(4.0, 8.0);
      const double foot = kShoulderEdgeM - 4.0;
      const double far_foot = kFarEdgeM + 4.0;
      const SE3 frame = line_.frame(at, 0.0, 0.0, random.uniform(-0.25, 0.25));
      mesh_.add_box(frame, {-half, foot - 25.0, 5.2}, {half, far_foot + 25.0, 6.4}, Material::kPavement);
      for (const double edge : {-half, half}) {
        mesh_.add_box(frame, {edge - 0.1, foot - 25.0, 6.4}, {edge + 0.1, far_foot + 25.0, 7.4},
                      Material::kMetal);
      }
      for (const double y : {foot, far_foot}) {
        mesh_.add_box(frame, {-half, y - 0.5, -1.0}, {half, y + 0.5, 5.2}, Material::kPavement);
      }
      for (const double x : {-0.7 * half, 0.0, 0.7 * half}) {
        mesh_.add_box(frame, {x - 0.4, 7.1, -0.5}, {x + 0.4, 8.1, 5.2}, Material::kPavement);
      }
      ++counts_.bridges;
    }
  }

  void add_plants() {
    RandomStream random(config_.seed, 207);
    for (double at = 0.0; at < line_.length_m(); at += random.uniform(4.0, 14.0)) {
      const double off = random.uniform(6.0, 40.0);
      const double left = random.chance(0.5) ? kShoulderEdgeM - off : kFarEdgeM + off;
      if (!random.chance(std::min(1.0, 0.7 * config_.density))) continue;
      const SE3 frame = line_.frame(at, left, verge(at, left), random.uniform(0.0, 3.0));
      if (random.chance(0.5)) {
        add_tree(mesh_, frame, random.uniform(1.5, 3.5), random);
      } else {
        add_bush(mesh_, frame, random.uniform(0.6, 1.8), random);
      }
      ++counts_.plants;
    }
  }

  /// Farms and halls beyond the fences.
  void add_buildings() {
    RandomStream random(config_.seed, 209);
    for (const double side : {-1.0, 1.0}) {
      for (double at = random.uniform(0.0, 60.0); at < line_.length_m(); at += random.uniform(40.0, 110.0)) {
        const BuildingPlan plan = random_building_plan(random.uniform(12.0, 26.0), 12.0, random);
        const double off = random.uniform(12.0, 35.0) + 0.5 * plan.depth_m;
        const double turned = random.uniform(-0.5, 0.5) + (side < 0.0 ? std::numbers::pi : 0.0);
        if (!random.chance(std::min(1.0, 0.8 * config_.density))) continue;
        const double left = side < 0.0 ? kShoulderEdgeM - off : kFarEdgeM + off;
        add_building(mesh_, line_.frame(at, left, verge(at, left), turned), plan);
        ++counts_.buildings;
      }
    }
  }

  const RoadLine& line_;
  const SceneConfig& config_;
  TriangleMesh& mesh_;
  Relief hills_;
  Relief bumps_;
  HighwayCounts counts_;
};

/// Traffic of one lane, all at one speed.
struct TrafficLane {
  double left_m;
  double speed_m_s;
  double truck_share;
  double least_gap_m;
  double largest_gap_m;
};

/// Adds the cars that come within range of the vehicle, which drives `own_m` in total.
void fill_lane(const RoadLine& line, const TrafficLane& lane, double own_m, double duration_s,
               double start_gap_m, RandomStream& random, std::vector<MovingCar>& cars) {
  const bool oncoming = lane.left_m > kMedianM;
  const std::vector<Vector3> path = line.path(lane.left_m, oncoming);
  const double own_start = oncoming ? static_cast<double>(path.size()) - kBeyondM : kBeyondM;
  const double drift = (oncoming ? -own_m : own_m) - lane.speed_m_s * duration_s;
  const double first = own_start + std::min(0.0, drift) - kBeyondM;
  const double last = own_start + std::max(0.0, drift) + kBeyondM;
  for (double start = first; start < last; start += random.uniform(lane.least_gap_m, lane.largest_gap_m)) {
    MovingCar car;
    car.model = random.chance(lane.truck_share) ? kTruckModel : random.index(kCarModels);
    if (!oncoming && std::abs(start - own_start) < start_gap_m) continue;
    car.path = path;
    car.speed_m_s = lane.speed_m_s;
    car.start_m = start;
    cars.push_back(std::move(car));
  }
}

/// Vehicles ahead and behind in the same lane that start with the vehicle and keep their distance.
void add_companions(const RoadLine& line, const SceneConfig& config, std::vector<MovingCar>& cars) {
  for (const double ahead : {60.0, -40.0}) {
    MovingCar car;
    car.model = ahead > 0.0 ? kTruckModel : 1;
    car.path = line.path(0.0, false);
    car.speed_m_s = *config.speed_m_s;
    car.start_m = kBeyondM + ahead;
    if (!config.moving_start) {
      // It came to rest at time 0.
      const double braking_s = car.speed_m_s / kHaltAcceleration;
      car.halt_m = car.start_m;
      car.halt_s = kStationaryTimeS;
      car.start_m += 0.5 * car.speed_m_s * braking_s;
    }
    cars.push_back(std::move(car));
  }
}

/// Lanes beside a vehicle in a queue: trucks that overtake it slowly on the right, cars on the left, both
/// without gaps; the other carriageway flows.
std::array<TrafficLane, 5> queue_lanes(double own) {
  return {{{-kLaneM, 0.55 * own, 0.9, 19.0, 24.0},
           {kLaneM, 0.7 * own, 0.5, 19.0, 26.0},
           {12.6, 25.0, 0.0, 40.0, 100.0},
           {16.3, 22.0, 0.15, 40.0, 90.0},
           {20.0, 18.0, 0.7, 40.0, 90.0}}};
}

std::vector<MovingCar> make_queue_traffic(const RoadLine& line, const SceneConfig& config, double own_m,
                                          double duration_s) {
  RandomStream random(config.seed, 208);
  std::vector<MovingCar> cars;
  for (const TrafficLane& lane : queue_lanes(*config.speed_m_s))
    fill_lane(line, lane, own_m, duration_s, 0.0, random, cars);
  if (config.moving_cars && cars.size() > *config.moving_cars) cars.resize(*config.moving_cars);
  return cars;
}

std::vector<MovingCar> make_highway_traffic(const RoadLine& line, const SceneConfig& config, double own_m,
                                            double duration_s) {
  const double own = *config.speed_m_s;
  const std::array<TrafficLane, 5> lanes{{{-kLaneM, 0.9 * own, 0.8, 26.0, 60.0},
                                          {kLaneM, 1.15 * own, 0.0, 25.0, 80.0},
                                          {12.6, 1.2 * own, 0.0, 30.0, 100.0},
                                          {16.3, 1.05 * own, 0.15, 30.0, 90.0},
                                          {20.0, 0.8 * own, 0.7, 30.0, 90.0}}};
  RandomStream random(config.seed, 208);
  std::vector<MovingCar> cars;
  add_companions(line, config, cars);
  for (const TrafficLane& lane : lanes) fill_lane(line, lane, own_m, duration_s, kStartGapM, random, cars);
  if (config.moving_cars && cars.size() > *config.moving_cars) cars.resize(*config.moving_cars);
  return cars;
}

/// Travelled distance: at constant speed, or starting with the others from a queue.
std::vector<double> drive_on_highway(const RoadLine& line, const SceneConfig& config, double speed,
                                     double duration_s, const std::vector<double>& halts_m) {
  if (config.moving_start) return travel_at(kBeyondM, speed, duration_s);
  DrivingStyle style;
  style.cruise_speed_m_s = speed;
  style.acceleration = kHaltAcceleration;
  std::vector<double> travelled = arc_length_over_time(
      line.route, speed_profile(line.route, line.length_m(), style, halts_m), line.length_m(), style);
  travelled.resize(std::min(travelled.size(), static_cast<std::size_t>(duration_s / kControlIntervalS) + 2));
  for (double& at : travelled) at += kBeyondM;
  return travelled;
}

/// Halts of a queue: every 12 to 40 m.
std::vector<double> queue_halts(double length_m, std::uint64_t seed) {
  RandomStream random(seed, 210);
  std::vector<double> halts;
  for (double at = random.uniform(10.0, 30.0); at < length_m; at += random.uniform(12.0, 40.0))
    halts.push_back(at);
  return halts;
}

core::Result<Scene> build_motorway(const SceneConfig& config, bool queue) {
  const double speed = *config.speed_m_s;
  // Acceleration to cruising speed takes half a minute.
  const double setting_off_s = config.moving_start ? 0.0 : 0.5 * speed / kHaltAcceleration + kStationaryTimeS;
  const double duration_s =
      wanted_duration(config.extent, speed, 60.0) + (config.extent.duration_s > 0.0 ? 0.0 : setting_off_s);
  const double length = 1.02 * speed * duration_s + 2.0 * kBeyondM;
  if (length > kLongestM)
    return core::Error{"the highway is at most 40 km long; take a shorter --duration or --length"};
  const double phase = RandomStream(config.seed, 200).uniform(0.0, 6.0);
  const RoadLine line = make_road_line(
      length, [&](double at) { return 0.12 * std::sin(at / 220.0 + phase); },
      [&](double at) { return 3.5 * std::sin(at / 150.0 - phase); });
  Scene scene;
  scene.mesh.porous_plants = config.porous_plants;
  const std::vector<double> travelled = drive_on_highway(
      line, config, speed, duration_s, queue ? queue_halts(length, config.seed) : std::vector<double>());
  scene.poses = cut_drive(drive_over(line.route, travelled, config.sway_speed(),
                                     [&](double at, const Vector2&) { return line.ground(at); }),
                          kControlIntervalS, config.extent);
  scene.road.roughness_m3 = 16e-6;
  const HighwayCounts counts = HighwayBuilder(line, config, scene.mesh).build();
  const double own_m = travelled.back() - kBeyondM;
  scene.cars = queue ? make_queue_traffic(line, config, own_m, duration_s)
                     : make_highway_traffic(line, config, own_m, duration_s);
  scene.contents = counted(counts.bridges, "bridges, ") + counted(counts.gantries, "gantries, ") +
                   counted(counts.signs, "signs, ") + counted(counts.buildings, "buildings, ") +
                   counted(counts.plants, "trees and bushes");
  return scene;
}

}  // namespace

core::Result<Scene> build_highway(const SceneConfig& config) { return build_motorway(config, false); }

core::Result<Scene> build_queue(const SceneConfig& config) { return build_motorway(config, true); }

}  // namespace nilio::tools::simulate
