#include "tools/simulate/town/town_drive.hpp"

#include "tools/simulate/geometry/relief.hpp"
#include "tools/simulate/geometry/route.hpp"
#include "tools/simulate/random.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

namespace nilio::tools::simulate {

namespace {

using core::SE3;

constexpr double kLaneOffsetM = 1.75;

struct Crossing {
  int column = 0;
  int row = 0;
};

/// Grid of streets; the crossings are shifted slightly, so that no two blocks are equal.
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

/// Driven centre lines: from the middle of the first street through crossings back to the start, or onwards.
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

/// Driving style: moderate, or at the limit of the tyres with 1 g of braking and 90 deg/s in corners of 4.4
/// m, which are then 0.7 g.
DrivingStyle style_of(const TownDriveConfig& config) {
  DrivingStyle style;
  style.cruise_speed_m_s = config.cruise_speed_m_s;
  style.moving_start = config.moving_start;
  if (!config.hard) return style;
  style.lateral_acceleration = 9.81;
  style.acceleration = 3.5;
  style.braking = 1.1 * 9.81;
  style.pedal_half_width = 2;
  return style;
}

/// Positions of the emergency stops.
std::vector<double> emergency_stops(double length_m) {
  std::vector<double> halts;
  for (double halt = 35.0; halt < length_m - 20.0; halt += 110.0) halts.push_back(halt);
  return halts;
}

constexpr double kQuarter = 0.5 * std::numbers::pi;

/// An arc: positive angles turn to the left.
DrivePiece arc(double radius_m, double angle_rad) {
  return {radius_m * std::abs(angle_rad), (angle_rad > 0.0 ? 1.0 : -1.0) / radius_m};
}

DriveMove forwards(std::vector<DrivePiece> pieces, double speed_m_s, std::vector<double> halts_m = {}) {
  return {std::move(pieces), speed_m_s, false, std::move(halts_m)};
}

DriveMove backwards(std::vector<DrivePiece> pieces, double speed_m_s) {
  return {std::move(pieces), speed_m_s, true, {}};
}

std::vector<double> halts_every(double spacing_m, double end_m) {
  std::vector<double> halts;
  for (double at = spacing_m; at < end_m - 5.0; at += spacing_m) halts.push_back(at);
  return halts;
}

}  // namespace

std::vector<SE3> make_town_drive(const TownDriveConfig& config) {
  double wanted_m = config.extent.length_m;
  const bool until_duration = config.extent.duration_s > 0.0 && wanted_m <= 0.0;
  if (until_duration) wanted_m = config.extent.duration_s * config.cruise_speed_m_s + 50.0;

  const CornerRadii radii = config.hard ? CornerRadii{4.0, 4.0, 4.0, 4.0} : CornerRadii{};
  const std::vector<Vector2> lane = to_lane(street_centres(config.seed, wanted_m));
  // Ramps of curvature take 10 m, or 1.5 m.
  const Route route =
      make_route(round_corners(lane, radii, RandomStream(config.seed, 13)), config.hard ? 2 : 10);
  const double stop_m =
      wanted_m > 0.0 ? std::min(wanted_m, route.arc_length.back()) : route.arc_length.back();
  const DrivingStyle style = style_of(config);
  const std::vector<double> halts = config.hard ? emergency_stops(stop_m) : std::vector<double>();
  const std::vector<double> speed = speed_profile(route, stop_m, style, halts);
  const std::vector<double> travelled = arc_length_over_time(route, speed, stop_m, style);

  // At most about 5 % steep.
  const Relief relief(RandomStream(config.seed, 12), 70.0, 220.0, 0.0018);
  const double sway_speed =
      config.steady_body ? std::numeric_limits<double>::infinity() : config.cruise_speed_m_s;
  std::vector<SE3> poses = drive_over(route, travelled, sway_speed,
                                      [&](double, const Vector2& place) { return relief.at(place); });
  return cut_drive(std::move(poses), kControlIntervalS, {0.0, config.extent.duration_s});
}

std::vector<DriveMove> town_script(SceneKind kind, double speed_m_s) {
  const DrivePiece straight{80.0, 0.0};
  switch (kind) {
    case SceneKind::kStopAndGo:
      return {forwards({straight, straight, straight}, speed_m_s, halts_every(16.0, 240.0))};
    case SceneKind::kRoundabout:
      // In to the right, nearly twice round to the left, out to the right.
      return {forwards({straight, arc(15.0, -0.7 * kQuarter), arc(15.0, 7.4 * kQuarter),
                        arc(15.0, -0.7 * kQuarter), straight},
                       speed_m_s)};
    case SceneKind::kReversing:
      return {forwards({straight}, speed_m_s),
              backwards({{30.0, 0.0}, arc(10.0, kQuarter), {15.0, 0.0}}, 0.3 * speed_m_s),
              forwards({{15.0, 0.0}, arc(10.0, -kQuarter), straight}, speed_m_s)};
    case SceneKind::kUTurn:
      return {forwards({straight, arc(5.5, 2.0 * kQuarter), straight}, speed_m_s)};
    case SceneKind::kThreePointTurn:
      return {forwards({straight, arc(5.5, 0.8 * kQuarter)}, speed_m_s),
              backwards({arc(5.5, 0.5 * kQuarter)}, 2.0),
              forwards({arc(5.5, 0.7 * kQuarter), straight}, speed_m_s)};
    case SceneKind::kHillHold:
      // Rolls back a little between the halts.
      return {forwards({{60.0, 0.0}}, speed_m_s), backwards({{1.5, 0.0}}, 0.6),
              forwards({{60.0, 0.0}}, speed_m_s, {25.0})};
    default:
      return {};
  }
}

std::vector<core::SE3> make_scripted_town_drive(SceneKind kind, const SceneConfig& config) {
  const Relief relief(RandomStream(config.seed, 12), 70.0, 220.0, 0.0018);
  const auto ground = [&](const Vector2& p) {
    GroundSlope slope = relief.at(p);
    if (kind == SceneKind::kHillHold) {
      constexpr double kSlope = 0.12;
      slope.height += kSlope * p.x();
      slope.gradient.x() += kSlope;
    }
    return slope;
  };
  return cut_drive(scripted_drive(town_script(kind, *config.speed_m_s), config.sway_speed(), ground),
                   kControlIntervalS, config.extent);
}

}  // namespace nilio::tools::simulate
