#include "tools/gnss/georeference.hpp"

#include "nilio/core/units.hpp"

#include "tools/common/statistics.hpp"
#include "tools/common/text.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include <Eigen/Dense>

namespace nilio::tools::gnss {

namespace {

using core::Error;
using core::Result;
using Eigen::Vector2d;

constexpr int kIterations = 20;
// Huber's threshold for 95 % efficiency, and the median of the length of a normal vector in the plane.
constexpr double kHuber = 1.345;
constexpr double kMedianLength = 1.1774;
// A path whose extent is smaller shows no heading, whatever the receiver states.
constexpr double kSmallestExtentM = 2.0;
constexpr double kExtentDeviations = 3.0;

/// Rotation about z and translation in the plane.
struct Planar {
  double yaw = 0.0;
  Vector2d translation = Vector2d::Zero();

  [[nodiscard]] Vector2d operator*(const Vector2d& p) const {
    return Eigen::Rotation2Dd(yaw) * p + translation;
  }
};

/// Weighted least squares in closed form; `scale` is that of the similarity.
Planar fit(const std::vector<Match>& matches, const std::vector<double>& weights, double& scale) {
  Vector2d mean_track = Vector2d::Zero();
  Vector2d mean_estimate = Vector2d::Zero();
  double sum = 0.0;
  for (std::size_t i = 0; i < matches.size(); ++i) {
    sum += weights[i];
    mean_track += weights[i] * matches[i].track.head<2>();
    mean_estimate += weights[i] * matches[i].estimate.head<2>();
  }
  mean_track /= sum;
  mean_estimate /= sum;
  double dot = 0.0;
  double cross = 0.0;
  double square = 0.0;
  for (std::size_t i = 0; i < matches.size(); ++i) {
    const Vector2d t = matches[i].track.head<2>() - mean_track;
    const Vector2d e = matches[i].estimate.head<2>() - mean_estimate;
    dot += weights[i] * e.dot(t);
    cross += weights[i] * (e.x() * t.y() - e.y() * t.x());
    square += weights[i] * e.squaredNorm();
  }
  Planar planar;
  planar.yaw = std::atan2(cross, dot);
  planar.translation = mean_track - Eigen::Rotation2Dd(planar.yaw) * mean_estimate;
  scale = square > 0.0 ? std::hypot(dot, cross) / square : 1.0;
  return planar;
}

/// Iteratively reweighted; the final weights replace those given.
Planar fit_robustly(const std::vector<Match>& matches, std::vector<double>& weights, double& scale) {
  const std::vector<double> stated = weights;
  Planar planar = fit(matches, weights, scale);
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    std::vector<double> lengths;
    for (std::size_t i = 0; i < matches.size(); ++i) {
      const Vector2d residual = matches[i].track.head<2>() - planar * matches[i].estimate.head<2>();
      lengths.push_back(std::sqrt(stated[i]) * residual.norm());
    }
    const double limit = kHuber * median(lengths) / kMedianLength;
    for (std::size_t i = 0; i < matches.size(); ++i)
      weights[i] = stated[i] * (lengths[i] > limit && limit > 0.0 ? limit / lengths[i] : 1.0);
    planar = fit(matches, weights, scale);
  }
  return planar;
}

/// Joint correction of position, heading and time that is linear in the residuals of the fit. Empty if the
/// time cannot be told from the others, or is no improvement beyond its own uncertainty.
std::optional<core::Duration> find_better_offset(const std::vector<Match>& matches,
                                                 const std::vector<double>& weights) {
  Eigen::Matrix4d information = Eigen::Matrix4d::Zero();
  Eigen::Vector4d gradient = Eigen::Vector4d::Zero();
  double square = 0.0;
  double sum = 0.0;
  for (std::size_t i = 1; i + 1 < matches.size(); ++i) {
    const double span_s = (matches[i + 1].stamp - matches[i - 1].stamp).seconds();
    const Vector2d velocity = (matches[i + 1].estimate - matches[i - 1].estimate).head<2>() / span_s;
    const Vector2d e = matches[i].estimate.head<2>();
    const Vector2d residual = matches[i].track.head<2>() - e;
    Eigen::Matrix<double, 2, 4> jacobian;
    jacobian << 1.0, 0.0, -e.y(), velocity.x(), 0.0, 1.0, e.x(), velocity.y();
    information += weights[i] * jacobian.transpose() * jacobian;
    gradient += weights[i] * jacobian.transpose() * residual;
    square += weights[i] * residual.squaredNorm();
    sum += 2.0;
  }
  if (sum < 20.0) return std::nullopt;
  const Eigen::Vector4d scale = information.diagonal().cwiseMax(1e-12).cwiseSqrt().cwiseInverse();
  const Eigen::Matrix4d scaled = scale.asDiagonal() * information * scale.asDiagonal();
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix4d> eigen(scaled);
  if (eigen.eigenvalues().minCoeff() < 1e-6) return std::nullopt;
  const Eigen::Vector4d step = information.ldlt().solve(gradient);
  const double left = square - step.dot(gradient);
  const double variance = left / sum * information.inverse()(3, 3);
  // Errors of receivers are correlated over seconds: their number says less than it seems.
  constexpr double kDeviations = 10.0;
  constexpr double kRemaining = 0.5;
  if (left > kRemaining * square || std::abs(step[3]) < kDeviations * std::sqrt(variance))
    return std::nullopt;
  return core::Duration::from_seconds(step[3]);
}

std::string range_text(core::Time first, core::Time last) {
  return format("%.3f .. %.3f s", static_cast<double>(first.ns) * 1e-9, static_cast<double>(last.ns) * 1e-9);
}

}  // namespace

Result<Georeference> georeference(const Trajectory& trajectory, const Track& track,
                                  const GeoreferenceOptions& options) {
  if (trajectory.stamps.empty()) return Error{trajectory.path + ": has no times - give a TUM file"};
  const GeodeticFrame frame = frame_at(track.fixes.front());
  Georeference result;
  std::vector<Match>& matches = result.matches;
  std::vector<double> deviations;
  for (const Fix& fix : track.fixes) {
    const core::Time stamp = fix.stamp + options.time_offset;
    const auto pose = interpolate_pose(trajectory, stamp, options.max_gap);
    if (!pose) continue;
    Match match;
    match.stamp = stamp;
    match.track = local(frame, fix);
    match.estimate = *pose * options.antenna;
    match.has_altitude = fix.altitude_m.has_value();
    match.deviation_m = fix.horizontal_deviation_m();
    if (fix.deviation_m && std::isfinite((*fix.deviation_m)[2])) match.up_deviation_m = (*fix.deviation_m)[2];
    if (match.deviation_m) deviations.push_back(*match.deviation_m);
    matches.push_back(match);
  }
  if (matches.size() < 3)
    return Error{format("%zu of %zu positions of ", matches.size(), track.fixes.size()) + track.name + " (" +
                 range_text(track.fixes.front().stamp, track.fixes.back().stamp) + ") are within poses of " +
                 trajectory.path + " (" + range_text(trajectory.stamps.front(), trajectory.stamps.back()) +
                 "); three are needed - check that both have the same clock, and --time-offset"};
  const double typical = deviations.empty() ? 1.0 : median(deviations);
  std::vector<double> weights;
  for (const Match& match : matches) weights.push_back(std::pow(match.deviation_m.value_or(typical), -2.0));
  const Planar planar = fit_robustly(matches, weights, result.scale);
  double extent = 0.0;
  for (const Match& match : matches)
    extent = std::max(extent, (match.estimate - matches.front().estimate).head<2>().norm());
  const double needed = std::max(kSmallestExtentM, deviations.empty() ? 0.0 : kExtentDeviations * typical);
  if (extent < needed)
    return Error{trajectory.path +
                 format(": moves %.1f m from its first position, and %.1f m are needed for a "
                        "heading by ",
                        extent, needed) +
                 track.name};
  std::vector<double> heights;
  for (const Match& match : matches) {
    if (match.has_altitude) heights.push_back(match.track.z() - match.estimate.z());
  }
  const double height = heights.empty() ? 0.0 : median(heights);
  Eigen::Isometry3d T_track_trajectory = Eigen::Isometry3d::Identity();
  T_track_trajectory.linear() = Eigen::AngleAxisd(planar.yaw, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  T_track_trajectory.translation() << planar.translation.x(), planar.translation.y(), height;
  for (Match& match : matches) match.estimate = T_track_trajectory * match.estimate;
  result.better_offset = find_better_offset(matches, weights);
  const auto [latitude, longitude, altitude] = frame.geodetic(T_track_trajectory.translation());
  const double heading_deg = 90.0 - planar.yaw / kRadiansPerDegree;
  result.origin = {latitude, longitude, altitude, heading_deg - 360.0 * std::floor(heading_deg / 360.0)};
  return result;
}

}  // namespace nilio::tools::gnss
