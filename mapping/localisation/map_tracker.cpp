#include "mapping/localisation/map_tracker.hpp"

#include "core/src/linear_algebra.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "mapping/loops/residuals.hpp"

namespace nilio::mapping {

namespace {

using core::Matrix6;
using core::SE3;
using core::Vector3;
using core::Vector6;

// Surfaces are loaded this far around the vehicle, again after it has moved.
constexpr double kLoadedMetres = 60.0;
constexpr double kReloadMetres = 15.0;
constexpr float kSearchMetres = 0.8F;
constexpr double kSupportedMetres = 0.2;
constexpr double kMaxRangeMetres = 40.0;
// Points of a keyframe; any first part of them is spread evenly over the scan.
constexpr std::size_t kPoints = 2500;
// The registration counts fully above the upper share of supported points, not at all below the lower one.
constexpr double kMinSupported = 0.35;
constexpr double kFullSupported = 0.55;
// Errors that the surfaces of the map share; of a guess; growth of the prediction's over a metre.
constexpr double kMapMetres = 0.03;
constexpr double kMapRadians = 0.001;
constexpr double kGuessMetres = 0.5;
constexpr double kGuessRadians = 0.02;
constexpr double kPredictionMetres = 0.01;
constexpr double kPredictionRadians = 0.0005;
constexpr std::array kKernelsMetres{0.5, 0.15};

Vector6 squares(double metres, double radians) {
  Vector6 variance;
  variance << Vector3::Constant(metres * metres), Vector3::Constant(radians * radians);
  return variance;
}

core::NormalEquations linearise(const SurfaceIndex& surfaces, std::span<const Vector3> points, const SE3& T,
                                double kernel_m) {
  core::NormalEquations equations;
  const core::Matrix3 R = T.rotation.toRotationMatrix();
  for (const Vector3& p : points) {
    const Vector3 q = R * p + T.translation;
    const Surface* const plane = surfaces.nearest_plane(q.cast<float>());
    if (plane == nullptr) continue;
    ++equations.correspondences;
    add_plane(*plane, p, q, R, kernel_m, equations);
  }
  return equations;
}

}  // namespace

void MapTracker::start(const SE3& T_map_base, const SE3& T_odom_base, const Matrix6& covariance) {
  T_map_base_ = T_map_base;
  T_odom_base_ = T_odom_base;
  covariance_ = covariance;
}

void MapTracker::load_around(const Vector3& position) {
  if (origin_ && (*origin_ - position).norm() < kReloadMetres) return;
  origin_ = position;
  const std::vector<Surface> surfaces = map_.surfaces_near(position, kLoadedMetres);
  surfaces_.emplace(surfaces, kSearchMetres);
}

MapMatch MapTracker::add(const Keyframe& keyframe) {
  const SE3 step = T_odom_base_.inverse() * keyframe.T_odom_base;
  const SE3 T_predicted = T_map_base_ * step;
  T_odom_base_ = keyframe.T_odom_base;
  const Matrix6 turned = core::adjoint(step.inverse());
  const double walk = std::max(step.translation.norm(), 0.1);
  covariance_ = turned * covariance_ * turned.transpose();
  covariance_ += squares(kPredictionMetres, kPredictionRadians).asDiagonal() * walk;
  MapMatch match{T_predicted, covariance_};
  load_around(T_predicted.translation);

  std::vector<Vector3> points;
  for (const MapPoint& point : keyframe.points) {
    if (points.size() >= kPoints) break;
    if (point.position.norm() < static_cast<float>(kMaxRangeMetres))
      points.push_back(point.position.cast<double>());
  }
  // About the origin of the loaded surfaces.
  core::RegistrationResult result;
  result.T_map_moving = T_predicted;
  result.T_map_moving.translation -= *origin_;
  core::SolverOptions options;
  options.max_iterations = 6;
  // Only against directions that the surfaces do not observe; the prediction enters afterwards.
  options.prior = core::PosePrior{result.T_map_moving, squares(kGuessMetres, kGuessRadians).asDiagonal()};
  for (const double kernel_m : kKernelsMetres)
    core::iterate([&](const SE3& T) { return linearise(*surfaces_, points, T, kernel_m); },
                  {core::WorkKind::kIcp, points.size()}, options, result);
  std::size_t supported = 0;
  for (const Vector3& p : points) {
    const Vector3 q = result.T_map_moving * p;
    const Surface* const plane = surfaces_->nearest_plane(q.cast<float>());
    if (plane == nullptr) continue;
    const double r = plane->normal.cast<double>().dot(q - plane->mean.cast<double>());
    supported += std::abs(r) < kSupportedMetres ? 1 : 0;
  }
  match.supported =
      points.empty() ? 0.0 : static_cast<double>(supported) / static_cast<double>(points.size());
  const double weight =
      std::clamp((match.supported - kMinSupported) / (kFullSupported - kMinSupported), 0.0, 1.0);
  if (weight > 0.0 && result.T_map_moving.is_finite()) {
    const Matrix6 spread =
        Matrix6::Identity() + result.information * squares(kMapMetres, kMapRadians).asDiagonal();
    Matrix6 information = weight * core::solve_lu(spread, result.information);
    information = 0.5 * (information + information.transpose()).eval();
    const Matrix6 prior = core::inverse_ldlt(covariance_);
    match.covariance = core::inverse_ldlt(Matrix6(prior + information));
    SE3 T_registered = result.T_map_moving;
    T_registered.translation += *origin_;
    const Vector6 offset = core::se3_log(T_predicted.inverse() * T_registered);
    const Vector6 correction = match.covariance * (information * offset);
    match.T_map_base = T_predicted * core::se3_exp(correction);
    match.is_used = true;
  }
  T_map_base_ = match.T_map_base;
  covariance_ = match.covariance;
  return match;
}

}  // namespace nilio::mapping
