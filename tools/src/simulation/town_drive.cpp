#include "simulation/town_drive.hpp"

#include "simulation/random.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace nilio::tools::simulation {

namespace {

using core::SE3;
using core::Vector3;
using Vector2 = Eigen::Vector2d;

constexpr double kStepM = 0.25;
constexpr double kLaneOffsetM = 1.75;
constexpr double kLateralAcceleration = 2.4;
constexpr double kAcceleration = 1.8;
constexpr double kBraking = 2.2;

struct Crossing {
  int column = 0;
  int row = 0;
};

/// Streets form a grid whose crossings are moved a little, so that no two blocks are equal.
class StreetGrid {
 public:
  static constexpr int kMin = -1;
  static constexpr int kMax = 3;

  explicit StreetGrid(std::uint64_t seed) : seed_(seed) {}

  [[nodiscard]] Vector2 position(Crossing c) const {
    const auto key = static_cast<std::uint64_t>(c.column * 64 + c.row + 4096);
    const double jitter_x = to_unit_interval(random_word(seed_, key, 1)) - 0.5;
    const double jitter_y = to_unit_interval(random_word(seed_, key, 2)) - 0.5;
    return {84.0 * c.column + 12.0 * jitter_x, 68.0 * c.row + 12.0 * jitter_y};
  }

  [[nodiscard]] Crossing random_successor(Crossing previous, Crossing current, RandomStream& random) const {
    static constexpr std::array<std::array<int, 2>, 4> moves{{{1, 0}, {0, 1}, {-1, 0}, {0, -1}}};
    while (true) {
      const auto& move = moves[random.index(4)];
      const Crossing next{current.column + move[0], current.row + move[1]};
      const bool inside = next.column >= kMin && next.column <= kMax && next.row >= kMin && next.row <= kMax;
      const bool back = next.column == previous.column && next.row == previous.row;
      if (inside && !back) return next;
    }
  }

 private:
  std::uint64_t seed_;
};

/// The centre lines driven: from the middle of the first street through crossings to the same place, or on.
std::vector<Vector2> street_centres(std::uint64_t seed, double length_m) {
  static constexpr std::array<Crossing, 11> tour{
      {{0, 0}, {1, 0}, {1, 1}, {0, 1}, {0, 0}, {1, 0}, {2, 0}, {2, 1}, {1, 1}, {1, 0}, {0, 0}}};
  const StreetGrid grid(seed);
  const Vector2 start = 0.5 * (grid.position(tour[0]) + grid.position(tour[1]));
  std::vector<Vector2> centres{start};
  for (std::size_t i = 1; i + 1 < tour.size(); ++i) centres.push_back(grid.position(tour[i]));

  double length = 0.0;
  for (std::size_t i = 1; i < centres.size(); ++i) length += (centres[i] - centres[i - 1]).norm();
  if (length_m <= length) {
    centres.push_back(start);
    return centres;
  }
  RandomStream random(seed, 11);
  Crossing previous = tour[tour.size() - 2];
  Crossing current = tour.back();
  // Corners are cut short, so the centre lines have to be longer than the drive.
  while (length < 1.2 * length_m + 100.0) {
    centres.push_back(grid.position(current));
    length += (centres.back() - centres[centres.size() - 2]).norm();
    const Crossing next = grid.random_successor(previous, current, random);
    previous = current;
    current = next;
  }
  return centres;
}

Vector2 right_of(const Vector2& direction) { return {direction.y(), -direction.x()}; }

/// Moves the polyline into the right-hand lane; `centres` makes no U-turn.
std::vector<Vector2> to_lane(const std::vector<Vector2>& centres) {
  std::vector<Vector2> lane;
  lane.reserve(centres.size());
  for (std::size_t i = 0; i < centres.size(); ++i) {
    const std::size_t a = i == 0 ? 0 : i - 1;
    const std::size_t b = i + 1 == centres.size() ? i - 1 : i;
    const Vector2 before = right_of((centres[a + 1] - centres[a]).normalized());
    const Vector2 after = right_of((centres[b + 1] - centres[b]).normalized());
    lane.push_back(centres[i] + kLaneOffsetM * (before + after) / (1.0 + before.dot(after)));
  }
  return lane;
}

/// Appends points every kStepM from the last point to `end`.
void append_line(std::vector<Vector2>& line, const Vector2& end) {
  const Vector2 start = line.back();
  const auto count = static_cast<std::size_t>(std::max(1.0, std::round((end - start).norm() / kStepM)));
  for (std::size_t i = 1; i <= count; ++i) {
    line.emplace_back(start + (end - start) * (static_cast<double>(i) / static_cast<double>(count)));
  }
}

/// Replaces the corners of a polyline by arcs.
std::vector<Vector2> round_corners(const std::vector<Vector2>& corners, RandomStream random) {
  std::vector<Vector2> line{corners.front()};
  for (std::size_t i = 1; i + 1 < corners.size(); ++i) {
    const Vector2 in = (corners[i] - corners[i - 1]).normalized();
    const Vector2 out = (corners[i + 1] - corners[i]).normalized();
    const double cross = in.x() * out.y() - in.y() * out.x();
    const double turn = std::atan2(cross, in.dot(out));
    const double radius =
        std::abs(turn) < 0.5 ? 40.0 : (turn > 0.0 ? random.uniform(10.5, 12.5) : random.uniform(8.0, 9.5));
    const double tangent = radius * std::tan(0.5 * std::abs(turn));
    append_line(line, corners[i] - tangent * in);
    const Vector2 normal = turn > 0.0 ? Vector2(-right_of(in)) : right_of(in);
    const Vector2 start = line.back();
    const auto count = static_cast<int>(std::ceil(radius * std::abs(turn) / kStepM));
    for (int k = 1; k <= count; ++k) {
      const double angle = std::abs(turn) * k / count;
      line.emplace_back(start + radius * (std::sin(angle) * in + (1.0 - std::cos(angle)) * normal));
    }
  }
  append_line(line, corners.back());
  return line;
}

/// Moving average over 2 * half_width + 1 values, `passes` times; beyond its ends the sequence continues as
/// it came.
template <class T>
std::vector<T> smooth(std::vector<T> values, std::size_t half_width, int passes) {
  const auto count = static_cast<std::ptrdiff_t>(values.size());
  const auto at = [&](std::ptrdiff_t i) -> T {
    if (i < 0) return 2.0 * values.front() - values[static_cast<std::size_t>(std::min(-i, count - 1))];
    if (i >= count) {
      return 2.0 * values.back() -
             values[static_cast<std::size_t>(std::max<std::ptrdiff_t>(2 * count - 2 - i, 0))];
    }
    return values[static_cast<std::size_t>(i)];
  };
  const auto half = static_cast<std::ptrdiff_t>(half_width);
  for (int pass = 0; pass < passes; ++pass) {
    std::vector<T> result(values.size());
    for (std::ptrdiff_t i = 0; i < count; ++i) {
      T sum = at(i - half);
      for (std::ptrdiff_t k = i - half + 1; k <= i + half; ++k) sum += at(k);
      result[static_cast<std::size_t>(i)] = sum / static_cast<double>(2 * half + 1);
    }
    values = std::move(result);
  }
  return values;
}

/// A plane curve with what the vehicle needs to know along it.
struct Route {
  std::vector<Vector2> points;
  std::vector<double> arc_length;
  std::vector<double> heading;    ///< unwrapped, rad
  std::vector<double> curvature;  ///< 1/m, left positive
};

Route make_route(std::vector<Vector2> points) {
  Route route;
  // Averaging over 5 m twice turns the steps of curvature into ramps of 10 m, as a driver steers.
  route.points = smooth(std::move(points), 10, 2);
  const std::size_t count = route.points.size();
  route.arc_length.assign(count, 0.0);
  route.heading.assign(count, 0.0);
  route.curvature.assign(count, 0.0);
  for (std::size_t i = 1; i < count; ++i) {
    route.arc_length[i] = route.arc_length[i - 1] + (route.points[i] - route.points[i - 1]).norm();
  }
  for (std::size_t i = 0; i < count; ++i) {
    const Vector2 d = route.points[std::min(i + 1, count - 1)] - route.points[i == 0 ? 0 : i - 1];
    const double heading = std::atan2(d.y(), d.x());
    const double previous = i == 0 ? heading : route.heading[i - 1];
    route.heading[i] = previous + std::remainder(heading - previous, 2.0 * std::numbers::pi);
  }
  for (std::size_t i = 1; i + 1 < count; ++i) {
    route.curvature[i] =
        (route.heading[i + 1] - route.heading[i - 1]) / (route.arc_length[i + 1] - route.arc_length[i - 1]);
  }
  return route;
}

/// Fastest speed along the route within the limits of acceleration that ends at `stop_m` with standing still.
std::vector<double> speed_profile(const Route& route, double stop_m, const TownDriveConfig& config) {
  const std::size_t count = route.points.size();
  std::vector<double> speed;
  speed.reserve(count);
  for (std::size_t i = 0; i < count; ++i) {
    const double corner = std::sqrt(kLateralAcceleration / std::max(std::abs(route.curvature[i]), 1e-6));
    const double left = std::max(0.0, stop_m - route.arc_length[i]);
    const bool stands = i == 0 && !config.moving_start;
    speed.push_back(stands ? 0.0
                           : std::min({config.cruise_speed_m_s, corner, std::sqrt(2.0 * kBraking * left)}));
  }
  for (std::size_t i = 1; i < count; ++i) {
    const double ds = route.arc_length[i] - route.arc_length[i - 1];
    speed[i] = std::min(speed[i], std::sqrt(speed[i - 1] * speed[i - 1] + 2.0 * kAcceleration * ds));
  }
  for (std::size_t i = count - 1; i > 0; --i) {
    const double ds = route.arc_length[i] - route.arc_length[i - 1];
    speed[i - 1] = std::min(speed[i - 1], std::sqrt(speed[i] * speed[i] + 2.0 * kBraking * ds));
  }
  return speed;
}

/// Arc length at every control instant: standing, driving, standing.
std::vector<double> arc_length_over_time(const Route& route, const std::vector<double>& speed, double stop_m,
                                         bool moving_start) {
  std::vector<double> result;
  const auto standing = static_cast<std::size_t>(std::lround(kStandingTimeS / kControlIntervalS));
  if (!moving_start) result.assign(standing, 0.0);
  double segment_start = 0.0;
  double next = 0.0;
  for (std::size_t i = 1; i < speed.size() && route.arc_length[i - 1] < stop_m; ++i) {
    const double ds = route.arc_length[i] - route.arc_length[i - 1];
    const double sum = speed[i] + speed[i - 1];
    if (sum <= 1e-9) break;
    const double dt = 2.0 * ds / sum;
    const double acceleration = (speed[i] - speed[i - 1]) / dt;
    for (; next <= segment_start + dt; next += kControlIntervalS) {
      const double t = next - segment_start;
      result.push_back(route.arc_length[i - 1] + speed[i - 1] * t + 0.5 * acceleration * t * t);
    }
    segment_start += dt;
  }
  const double end = result.empty() ? 0.0 : result.back();
  result.insert(result.end(), standing, end);
  // Limits the jerk; 0.65 s twice is how a person works the pedals.
  return smooth(std::move(result), 6, 2);
}

/// Height and slopes of gently rolling country, at most about 5 %.
struct Relief {
  struct Wave {
    Vector2 number;  ///< rad/m
    double phase = 0.0;
    double amplitude = 0.0;
  };
  std::array<Wave, 5> waves;

  explicit Relief(std::uint64_t seed) {
    RandomStream random(seed, 12);
    for (Wave& wave : waves) {
      const double length = random.uniform(70.0, 220.0);
      const double direction = random.uniform(0.0, 2.0 * std::numbers::pi);
      wave.number = 2.0 * std::numbers::pi / length * Vector2(std::cos(direction), std::sin(direction));
      wave.phase = random.uniform(0.0, 2.0 * std::numbers::pi);
      wave.amplitude = 0.0018 * length;
    }
  }

  [[nodiscard]] double height(const Vector2& p) const {
    double z = 0.0;
    for (const Wave& wave : waves) z += wave.amplitude * std::sin(wave.number.dot(p) + wave.phase);
    return z;
  }
  [[nodiscard]] Vector2 gradient(const Vector2& p) const {
    Vector2 g = Vector2::Zero();
    for (const Wave& wave : waves)
      g += wave.amplitude * std::cos(wave.number.dot(p) + wave.phase) * wave.number;
    return g;
  }
};

/// Place, heading and curvature at an arc length.
struct RoutePoint {
  Vector2 position;
  double heading = 0.0;
  double curvature = 0.0;
};

RoutePoint route_at(const Route& route, double arc_length) {
  const auto upper = std::upper_bound(route.arc_length.begin() + 1, route.arc_length.end() - 1, arc_length);
  const auto b = static_cast<std::size_t>(upper - route.arc_length.begin());
  const std::size_t a = b - 1;
  const double share = (arc_length - route.arc_length[a]) / (route.arc_length[b] - route.arc_length[a]);
  return {route.points[a] + share * (route.points[b] - route.points[a]),
          std::lerp(route.heading[a], route.heading[b], share),
          std::lerp(route.curvature[a], route.curvature[b], share)};
}

/// Puts the vehicle on the ground: slopes, and a body that sways on its springs with speed and leans with
/// acceleration.
SE3 place_vehicle(const RoutePoint& at, const Relief& relief, double time_s, double speed,
                  double acceleration, double cruise_speed) {
  const double tau = 2.0 * std::numbers::pi * time_s;
  const double liveliness = speed / cruise_speed;
  const Vector2 forward(std::cos(at.heading), std::sin(at.heading));
  const Vector2 slope = relief.gradient(at.position);
  const double pitch = -std::atan(slope.dot(forward)) - 0.004 * acceleration +
                       liveliness * (0.0026 * std::sin(1.13 * tau) + 0.0015 * std::sin(1.71 * tau + 1.0));
  const double roll = -std::atan(slope.dot(right_of(forward))) + 0.006 * speed * speed * at.curvature +
                      liveliness * (0.0022 * std::sin(1.37 * tau + 2.0) + 0.0012 * std::sin(1.93 * tau));
  const double heave = 0.008 * liveliness * std::sin(1.29 * tau + 0.5);
  SE3 T_world_base;
  T_world_base.rotation = Eigen::AngleAxisd(at.heading, Vector3::UnitZ()) *
                          Eigen::AngleAxisd(pitch, Vector3::UnitY()) *
                          Eigen::AngleAxisd(roll, Vector3::UnitX());
  T_world_base.translation << at.position, relief.height(at.position) + heave;
  return T_world_base;
}

}  // namespace

std::vector<SE3> make_town_drive(const TownDriveConfig& config) {
  double wanted_m = config.extent.length_m;
  const bool until_duration = config.extent.duration_s > 0.0 && wanted_m <= 0.0;
  if (until_duration) wanted_m = config.extent.duration_s * config.cruise_speed_m_s + 50.0;

  const std::vector<Vector2> lane = to_lane(street_centres(config.seed, wanted_m));
  const Route route = make_route(round_corners(lane, RandomStream(config.seed, 13)));
  const double stop_m =
      wanted_m > 0.0 ? std::min(wanted_m, route.arc_length.back()) : route.arc_length.back();
  const std::vector<double> speed = speed_profile(route, stop_m, config);
  const std::vector<double> travelled = arc_length_over_time(route, speed, stop_m, config.moving_start);

  const Relief relief(config.seed);
  std::vector<SE3> poses;
  poses.reserve(travelled.size());
  for (std::size_t i = 0; i < travelled.size(); ++i) {
    const double before = i == 0 ? 2.0 * travelled[0] - travelled[1] : travelled[i - 1];
    const double after = i + 1 == travelled.size() ? travelled[i] : travelled[i + 1];
    const double v = (after - before) / (2.0 * kControlIntervalS);
    const double a = (after - 2.0 * travelled[i] + before) / (kControlIntervalS * kControlIntervalS);
    poses.push_back(place_vehicle(route_at(route, travelled[i]), relief,
                                  static_cast<double>(i) * kControlIntervalS, v, a, config.cruise_speed_m_s));
  }
  return cut_drive(std::move(poses), kControlIntervalS, {0.0, config.extent.duration_s});
}

}  // namespace nilio::tools::simulation
