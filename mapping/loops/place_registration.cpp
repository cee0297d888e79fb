#include "mapping/loops/place_registration.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>
#include <unordered_map>
#include <unordered_set>
#include <utility>

#include "mapping/loops/residuals.hpp"

namespace nilio::mapping {

namespace {

using core::Matrix3;
using core::SE3;
using core::Vector3;
using Eigen::Vector3f;

constexpr double kPlaneDeviationMetres = 0.05;
// The means of an irregular voxel depend on where its grid lies.
constexpr double kIrregularDeviationMetres = 0.3;
// Structure farther from a path is seen by few beams.
constexpr float kComparedMetres = 25.0F;
constexpr float kSupportPlaneMetres = 0.2F;
constexpr float kSupportMetres = 0.8F;
constexpr float kOverlapVoxelMetres = 1.0F;
/// Free space along a ray is taken of its far half, where the height of the sensor above base_link does not
/// matter, and ends before the surface.
constexpr float kFreeFrom = 0.5F;
constexpr float kFreeEndMetres = 1.5F;

struct FloatTransform {
  explicit FloatTransform(const SE3& T)
      : R(T.rotation.toRotationMatrix().cast<float>()), t(T.translation.cast<float>()) {}
  Eigen::Matrix3f R;
  Vector3f t;
};

core::NormalEquations linearise(const SurfaceIndex& index, std::span<const Surface> moving, const SE3& T,
                                double kernel_m) {
  core::NormalEquations equations;
  const Matrix3 R = T.rotation.toRotationMatrix();
  for (const Surface& surface : moving) {
    const Vector3 p = surface.mean.cast<double>();
    const Vector3 q = T * p;
    const Vector3 n = R * surface.normal.cast<double>();
    const Surface* const other = index.nearest(q.cast<float>(), n.cast<float>(), surface.is_plane);
    if (other == nullptr) continue;
    ++equations.correspondences;
    if (surface.is_plane) {
      add_plane(*other, p, q, R, kernel_m, equations);
      continue;
    }
    const Vector3 d = q - other->mean.cast<double>();
    constexpr double share = kPlaneDeviationMetres / kIrregularDeviationMetres;
    const double weight = share * share * geman_mcclure(d.norm(), kernel_m + kIrregularDeviationMetres);
    for (int axis = 0; axis < 3; ++axis) {
      const Vector3 m = R.row(axis).transpose();
      core::Vector6 row;
      row << m, p.cross(m);
      add_row(row, d[axis], weight, equations);
    }
  }
  return equations;
}

bool is_supported(const SurfaceIndex& index, const Vector3f& mean, const Vector3f& normal, bool is_plane) {
  const Surface* const other = index.nearest(mean, normal, is_plane);
  if (other == nullptr) return false;
  return !is_plane || std::abs(other->normal.dot(mean - other->mean)) < kSupportPlaneMetres;
}

/// Voxels of 1 m that rays of the place have crossed and that hold no surface of it, nor do their neighbours.
std::unordered_set<VoxelKey> free_space_of(const Place& place, const SurfaceIndex& index) {
  std::unordered_set<VoxelKey> free;
  for (std::size_t i = 0; i < place.surfaces.size(); ++i) {
    const Vector3f end = place.surfaces[i].mean;
    const Vector3f ray = end - place.path[place.viewers[i]].translation.cast<float>();
    const float length = ray.norm();
    const Vector3f step = ray / std::max(length, 1e-3F) * kOverlapVoxelMetres;
    const int steps = static_cast<int>(((1.0F - kFreeFrom) * length - kFreeEndMetres) / kOverlapVoxelMetres);
    for (int k = 0; k < steps; ++k) {
      const Vector3f p = end - kFreeEndMetres * ray / length - static_cast<float>(k) * step;
      if (const auto key = key_of(index_at(p, kOverlapVoxelMetres))) free.insert(*key);
    }
  }
  std::erase_if(free, [&](VoxelKey key) {
    const Eigen::Vector3i centre = index_of(key);
    for (int i = 0; i < 27; ++i) {
      if (index.has_voxel(centre + Eigen::Vector3i(i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1))) return true;
    }
    return false;
  });
  return free;
}

struct Comparison {
  std::uint32_t compared = 0;
  std::uint32_t supported = 0;
  std::uint32_t contradicted = 0;
  [[nodiscard]] double share(std::uint32_t count) const {
    return compared > 0 ? static_cast<double>(count) / compared : 0.0;
  }
};

/// Structure of `moving` in the reference.
Comparison compare(const ComparablePlace& reference, const Place& moving, const SE3& T) {
  const FloatTransform F(T);
  std::vector<SE3> path;
  for (const SE3& pose : moving.path) path.push_back(T * pose);
  Comparison result;
  for (const Surface& surface : moving.surfaces) {
    if (!is_structure(surface)) continue;
    const Vector3f mean = F.R * surface.mean + F.t;
    if (!is_near(reference.place().path, mean) || !is_near(path, mean)) continue;
    ++result.compared;
    if (is_supported(reference.voxels(), mean, F.R * surface.normal, surface.is_plane)) ++result.supported;
    const auto key = key_of(index_at(mean, kOverlapVoxelMetres));
    if (key && reference.is_free(*key)) ++result.contradicted;
  }
  return result;
}

double overlap_of(const SurfaceIndex& reference, const ComparablePlace& moving, const SE3& T) {
  const FloatTransform F(T);
  std::unordered_set<VoxelKey> seen;
  std::size_t common = 0;
  for (const Surface& surface : moving.place().surfaces) {
    const auto own = key_of(index_at(surface.mean, kOverlapVoxelMetres));
    if (!own || !seen.insert(*own).second) continue;
    const Eigen::Vector3i centre = index_at(F.R * surface.mean + F.t, kOverlapVoxelMetres);
    bool found = false;
    for (int i = 0; i < 27 && !found; ++i)
      found = reference.has_voxel(centre + Eigen::Vector3i(i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1));
    common += found ? 1 : 0;
  }
  const std::size_t smaller = std::min(reference.voxels(), moving.voxels().voxels());
  return smaller > 0 ? std::min(1.0, static_cast<double>(common) / static_cast<double>(smaller)) : 0.0;
}

double self_support_of(const Place& place) {
  std::array<std::vector<Surface>, 2> halves;
  for (std::size_t i = 0; i < place.surfaces.size(); ++i)
    halves[place.viewers[i] % 2].push_back(place.surfaces[i]);
  const SurfaceIndex even(halves[0], kOverlapVoxelMetres);
  Comparison result;
  for (const Surface& surface : halves[1]) {
    if (!is_structure(surface) || !is_near(place.path, surface.mean)) continue;
    ++result.compared;
    if (is_supported(even, surface.mean, surface.normal, surface.is_plane)) ++result.supported;
  }
  return result.share(result.supported);
}

/// Every `stride`th surface.
std::vector<Surface> part_of(const Place& place, std::size_t stride) {
  std::vector<Surface> part;
  for (std::size_t i = 0; i < place.surfaces.size(); i += std::max<std::size_t>(1, stride))
    part.push_back(place.surfaces[i]);
  return part;
}

/// Covariance of the guess: position from features, heading from features, tilt from gravity.
core::Matrix6 guess_covariance() {
  core::Vector6 sigma;
  sigma << 2.0, 2.0, 1.0, 0.02, 0.02, 0.08;
  return sigma.cwiseAbs2().asDiagonal();
}

}  // namespace

bool is_near(const std::vector<SE3>& path, const Vector3f& point) {
  return std::any_of(path.begin(), path.end(), [&](const SE3& pose) {
    return (pose.translation.cast<float>() - point).squaredNorm() < kComparedMetres * kComparedMetres;
  });
}

ComparablePlace::ComparablePlace(const Place& place)
    : place_(place),
      surfaces_(place.surfaces, kSupportMetres),
      voxels_(place.surfaces, kOverlapVoxelMetres),
      free_(free_space_of(place, voxels_)),
      self_support_(self_support_of(place)) {}

PlaceAlignment align_places(const ComparablePlace& reference, const ComparablePlace& moving, const SE3& guess,
                            std::size_t surfaces) {
  core::RegistrationResult result;
  result.T_map_moving = guess;
  core::SolverOptions options;
  options.max_iterations = 12;
  options.prior = core::PosePrior{guess, guess_covariance()};
  // A part of the surfaces is enough to come near.
  const std::vector<Surface> part = part_of(moving.place(), moving.place().surfaces.size() / surfaces);
  const SurfaceIndex wide(part_of(reference.place(), kRegisteredSurfaces / surfaces), 2.0F);
  const SurfaceIndex* const narrow = &reference.surfaces();
  for (const auto& [index, kernel_m] :
       {std::pair{&std::as_const(wide), 1.0}, std::pair{narrow, 0.4}, std::pair{narrow, 0.15}})
    core::iterate([&](const SE3& T) { return linearise(*index, part, T, kernel_m); },
                  {core::WorkKind::kIcp, part.size()}, options, result);
  PlaceAlignment alignment;
  alignment.T_reference_moving = result.T_map_moving;
  alignment.information = result.information;
  const SE3& T = result.T_map_moving;
  alignment.overlap = overlap_of(reference.voxels(), moving, T);
  const Comparison forward = compare(reference, moving.place(), T);
  const Comparison backward = compare(moving, reference.place(), T.inverse());
  alignment.compared = std::min(forward.compared, backward.compared);
  alignment.support = std::min(forward.share(forward.supported), backward.share(backward.supported));
  alignment.larger_support = std::max(forward.share(forward.supported), backward.share(backward.supported));
  alignment.contradiction =
      std::max(forward.share(forward.contradicted), backward.share(backward.contradicted));
  return alignment;
}

double ambiguity(const Place& reference, const Place& moving, const SE3& T) {
  // Both on a horizontal grid of 1 m, in axes of the reference: structure near both paths.
  constexpr int kHalf = 128;
  constexpr int kReach = 40;
  constexpr int kExcluded = 4;
  const auto column = [](const Vector3f& p) -> std::optional<std::size_t> {
    const Eigen::Vector3i index = index_at(p, kOverlapVoxelMetres);
    if (std::abs(index.x()) >= kHalf - kReach || std::abs(index.y()) >= kHalf - kReach) return std::nullopt;
    return static_cast<std::size_t>((index.y() + kHalf) * 2 * kHalf + index.x() + kHalf);
  };
  std::vector<float> image(4 * kHalf * kHalf, 0.0F);
  for (const Surface& surface : reference.surfaces) {
    if (!is_structure(surface) || !is_near(reference.path, surface.mean)) continue;
    if (const auto i = column(surface.mean)) image[*i] = std::min(image[*i] + 1.0F, 4.0F);
  }
  const FloatTransform F(T);
  std::unordered_map<std::size_t, float> weights;
  for (const Surface& surface : moving.surfaces) {
    if (!is_structure(surface) || !is_near(moving.path, surface.mean)) continue;
    if (const auto i = column(F.R * surface.mean + F.t)) {
      float& weight = weights[*i];
      weight = std::min(weight + 1.0F, 4.0F);
    }
  }
  std::vector<std::pair<std::size_t, float>> cells(weights.begin(), weights.end());
  std::sort(cells.begin(), cells.end());
  // Cosine of the angle between both, over the cells of the moving place that hold structure.
  const auto correlation = [&](int dx, int dy) {
    double product = 0.0;
    double square = 0.0;
    for (const auto& [cell, weight] : cells) {
      const float other = image[static_cast<std::size_t>(static_cast<int>(cell) + dy * 2 * kHalf + dx)];
      product += static_cast<double>(weight * other);
      square += static_cast<double>(other * other);
    }
    return square > 0.0 ? product / std::sqrt(square) : 0.0;
  };
  double at_alignment = 0.0;
  double elsewhere = 0.0;
  for (int dy = -kReach; dy <= kReach; ++dy) {
    for (int dx = -kReach; dx <= kReach; ++dx) {
      const int square = dx * dx + dy * dy;
      if (square > kReach * kReach || (square > 2 && square <= kExcluded * kExcluded)) continue;
      double& best = square <= 2 ? at_alignment : elsewhere;
      best = std::max(best, correlation(dx, dy));
    }
  }
  return at_alignment > 0.0 ? elsewhere / at_alignment : 1.0;
}

}  // namespace nilio::mapping
