#include "tools/simulate/town/town_scripts.hpp"

#include "tools/simulate/geometry/relief.hpp"

#include <cmath>
#include <numbers>
#include <utility>

namespace nilio::tools::simulate {

namespace {

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
