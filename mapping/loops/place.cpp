#include "mapping/loops/place.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <numeric>
#include <tuple>

namespace nilio::mapping {

namespace {

using Eigen::Vector2f;

constexpr float kPixelMetres = 0.5F;
constexpr int kHalfImage = 160;  // pixels
constexpr int kImage = 2 * kHalfImage;
/// Cells of a column beyond this height tell more of the beams than of the place.
constexpr float kMaxDensity = 8.0F;
constexpr int kPatchRadius = 15;
constexpr std::size_t kMaxFeatures = 500;
constexpr int kSuppressionRadius = 2;
constexpr float kMinResponse = 0.05F;
constexpr int kMaxHamming = 64;
constexpr std::size_t kMaxMatches = 160;
constexpr float kInlierMetres = 1.5F;
constexpr float kMinBaseMetres = 8.0F;
constexpr double kOtherPlaceMetres = 5.0;
constexpr double kOtherPlaceCosine = 0.985;  // 10 degrees

/// Density image: occupied cells of 0.5 m in each column, smoothed.
class DensityImage {
 public:
  explicit DensityImage(std::span<const Surface> surfaces) : pixels_(kImage * kImage, 0.0F) {
    for (const Surface& surface : surfaces) {
      if (!is_structure(surface)) continue;
      splat(surface.mean.head<2>(), surface.is_plane ? 1.0F : 4.0F);
    }
    for (float& pixel : pixels_) pixel = std::min(pixel, kMaxDensity);
    smooth();
  }

  [[nodiscard]] float at(int x, int y) const { return pixels_[static_cast<std::size_t>(y * kImage + x)]; }

 private:
  /// Distributes a surface to the four pixels around it.
  void splat(const Vector2f& position, float cells) {
    const Vector2f p = position / kPixelMetres + Vector2f::Constant(kHalfImage - 0.5F);
    if (!(p.minCoeff() >= 0.0F && p.maxCoeff() < static_cast<float>(kImage - 1))) return;
    const Eigen::Vector2i corner = p.cast<int>();
    const Vector2f share = p - corner.cast<float>();
    for (int i = 0; i < 4; ++i) {
      const int dx = i & 1;
      const int dy = i >> 1;
      const float weight =
          (dx == 1 ? share.x() : 1.0F - share.x()) * (dy == 1 ? share.y() : 1.0F - share.y());
      pixels_[static_cast<std::size_t>((corner.y() + dy) * kImage + corner.x() + dx)] += cells * weight;
    }
  }

  /// Binomial filter of five pixels along both axes.
  void smooth() {
    std::vector<float> line(kImage);
    for (int pass = 0; pass < 2 * kImage; ++pass) {
      const std::size_t step = pass < kImage ? 1 : kImage;
      const std::size_t begin =
          pass < kImage ? static_cast<std::size_t>(pass * kImage) : static_cast<std::size_t>(pass - kImage);
      for (std::size_t i = 0; i < line.size(); ++i) line[i] = pixels_[begin + i * step];
      for (std::size_t i = 2; i + 2 < line.size(); ++i)
        pixels_[begin + i * step] =
            (6.0F * line[i] + 4.0F * (line[i - 1] + line[i + 1]) + line[i - 2] + line[i + 2]) / 16.0F;
    }
  }

  std::vector<float> pixels_;
};

struct Corner {
  float response = 0.0F;
  int x = 0;
  int y = 0;
};

/// Smaller eigenvalue of the structure tensor (Shi and Tomasi 1994) where it has a local maximum.
std::vector<Corner> corners_of(const DensityImage& image) {
  std::vector<float> response(kImage * kImage, 0.0F);
  for (int y = kPatchRadius + 1; y < kImage - kPatchRadius - 1; ++y) {
    for (int x = kPatchRadius + 1; x < kImage - kPatchRadius - 1; ++x) {
      float xx = 0.0F;
      float xy = 0.0F;
      float yy = 0.0F;
      for (int v = y - 2; v <= y + 2; ++v) {
        for (int u = x - 2; u <= x + 2; ++u) {
          const float gx = image.at(u + 1, v) - image.at(u - 1, v);
          const float gy = image.at(u, v + 1) - image.at(u, v - 1);
          xx += gx * gx;
          xy += gx * gy;
          yy += gy * gy;
        }
      }
      response[static_cast<std::size_t>(y * kImage + x)] =
          0.5F * (xx + yy - std::sqrt((xx - yy) * (xx - yy) + 4.0F * xy * xy));
    }
  }
  std::vector<Corner> corners;
  for (int y = kPatchRadius + 1; y < kImage - kPatchRadius - 1; ++y) {
    for (int x = kPatchRadius + 1; x < kImage - kPatchRadius - 1; ++x) {
      const float value = response[static_cast<std::size_t>(y * kImage + x)];
      bool is_maximum = value > kMinResponse;
      for (int v = -kSuppressionRadius; v <= kSuppressionRadius && is_maximum; ++v) {
        for (int u = -kSuppressionRadius; u <= kSuppressionRadius && is_maximum; ++u)
          is_maximum = response[static_cast<std::size_t>((y + v) * kImage + x + u)] <= value;
      }
      if (is_maximum) corners.push_back({value, x, y});
    }
  }
  std::sort(corners.begin(), corners.end(), [](const Corner& a, const Corner& b) {
    return std::tie(b.response, a.y, a.x) < std::tie(a.response, b.y, b.x);
  });
  if (corners.size() > kMaxFeatures) corners.resize(kMaxFeatures);
  return corners;
}

struct PixelPair {
  Vector2f a;
  Vector2f b;
};

/// Pairs of points in the patch: sums of uniform numbers, so that most lie near its centre (BRIEF).
std::array<PixelPair, 256> make_pairs() {
  std::uint64_t state = 1;
  const auto coordinate = [&state] {
    float sum = 0.0F;
    for (int i = 0; i < 3; ++i) {
      state = state * 6364136223846793005ULL + 1442695040888963407ULL;
      sum += static_cast<float>(state >> 40U) / static_cast<float>(1U << 24U) - 0.5F;
    }
    return sum * 2.0F / 3.0F * static_cast<float>(kPatchRadius - 1) / 1.4143F;
  };
  std::array<PixelPair, 256> pairs;
  for (PixelPair& pair : pairs) {
    for (Vector2f* const point : {&pair.a, &pair.b}) {
      point->x() = coordinate();
      point->y() = coordinate();
    }
  }
  return pairs;
}

/// Rotated by the direction to the centroid of the patch (ORB, Rublee et al. 2011).
PlaceFeature describe(const DensityImage& image, const Corner& corner) {
  static const std::array<PixelPair, 256> pairs = make_pairs();
  Vector2f moment = Vector2f::Zero();
  for (int v = -kPatchRadius; v <= kPatchRadius; ++v) {
    for (int u = -kPatchRadius; u <= kPatchRadius; ++u) {
      if (u * u + v * v > kPatchRadius * kPatchRadius) continue;
      moment += image.at(corner.x + u, corner.y + v) * Vector2f(static_cast<float>(u), static_cast<float>(v));
    }
  }
  const float length = moment.norm();
  const Vector2f direction = length > 0.0F ? Vector2f(moment / length) : Vector2f::UnitX();
  Eigen::Matrix2f R;
  R << direction.x(), -direction.y(), direction.y(), direction.x();
  const auto value = [&](const Vector2f& offset) {
    const Vector2f p = R * offset;
    return image.at(corner.x + static_cast<int>(std::lround(p.x())),
                    corner.y + static_cast<int>(std::lround(p.y())));
  };
  PlaceFeature feature;
  feature.position = kPixelMetres * Vector2f(static_cast<float>(corner.x - kHalfImage) + 0.5F,
                                             static_cast<float>(corner.y - kHalfImage) + 0.5F);
  for (std::size_t i = 0; i < pairs.size(); ++i)
    feature.bits[i / 64] |= std::uint64_t{value(pairs[i].a) < value(pairs[i].b)} << (i % 64);
  return feature;
}

struct Match {
  int hamming = 0;
  Vector2f reference;
  Vector2f moving;
};

std::vector<Match> match(std::span<const PlaceFeature> reference, std::span<const PlaceFeature> moving) {
  std::vector<Match> matches;
  for (const PlaceFeature& feature : moving) {
    int best = kMaxHamming + 1;
    const PlaceFeature* nearest = nullptr;
    for (const PlaceFeature& other : reference) {
      int distance = 0;
      for (std::size_t i = 0; i < 4; ++i) distance += std::popcount(feature.bits[i] ^ other.bits[i]);
      if (distance >= best) continue;
      best = distance;
      nearest = &other;
    }
    if (nearest != nullptr) matches.push_back({best, nearest->position, feature.position});
  }
  std::stable_sort(matches.begin(), matches.end(),
                   [](const Match& a, const Match& b) { return a.hamming < b.hamming; });
  if (matches.size() > kMaxMatches) matches.resize(kMaxMatches);
  return matches;
}

/// Planar transform as a rotation (cosine, sine) and a translation.
struct Planar {
  Vector2f direction = Vector2f::UnitX();
  Vector2f translation = Vector2f::Zero();

  [[nodiscard]] Vector2f operator*(const Vector2f& p) const {
    return Vector2f(direction.x() * p.x() - direction.y() * p.y(),
                    direction.y() * p.x() + direction.x() * p.y()) +
           translation;
  }
};

/// Least squares over matches (Umeyama 1991).
Planar fit(std::span<const Match* const> matches) {
  Vector2f reference = Vector2f::Zero();
  Vector2f moving = Vector2f::Zero();
  for (const Match* m : matches) {
    reference += m->reference;
    moving += m->moving;
  }
  reference /= static_cast<float>(matches.size());
  moving /= static_cast<float>(matches.size());
  Vector2f sum = Vector2f::Zero();
  for (const Match* m : matches) {
    const Vector2f r = m->reference - reference;
    const Vector2f p = m->moving - moving;
    sum += Vector2f(p.dot(r), p.x() * r.y() - p.y() * r.x());
  }
  Planar result;
  if (sum.norm() > 0.0F) result.direction = sum.normalized();
  result.translation = reference - Planar{result.direction, Vector2f::Zero()} * moving;
  return result;
}

std::vector<const Match*> inliers_of(const Planar& T, std::span<const Match> matches) {
  std::vector<const Match*> inliers;
  for (const Match& m : matches) {
    if ((T * m.moving - m.reference).squaredNorm() < kInlierMetres * kInlierMetres) inliers.push_back(&m);
  }
  return inliers;
}

core::SE3 to_space(const Planar& T) {
  // Half-angle formulas: no trigonometric functions.
  const double c = static_cast<double>(T.direction.x());
  const double s = static_cast<double>(T.direction.y());
  const double w = std::sqrt(std::max(0.0, 0.5 * (1.0 + c)));
  const double z = std::copysign(std::sqrt(std::max(0.0, 0.5 * (1.0 - c))), s);
  core::SE3 result;
  result.rotation = Eigen::Quaterniond(w, 0.0, 0.0, z).normalized();
  result.translation.head<2>() = T.translation.cast<double>();
  return result;
}

}  // namespace

bool is_structure(const Surface& surface) {
  constexpr float kMinHorizontalNormal = 0.9F;
  return !surface.is_plane || std::abs(surface.normal.z()) < kMinHorizontalNormal;
}

core::SE3 place_origin(const Submap& submap) {
  core::SE3 T;
  if (!submap.keyframes.empty())
    T.translation = submap.keyframes[submap.keyframes.size() / 2].T_submap_base.translation;
  return T;
}

Place make_place(std::span<const Submap* const> submaps, std::size_t middle) {
  Place place;
  place.id = submaps[middle]->id;
  place.T_odom_place = submaps[middle]->T_odom_submap * place_origin(*submaps[middle]);
  std::vector<core::Time> stamps;
  for (const Submap* const submap : submaps) {
    const core::SE3 T = place.T_odom_place.inverse() * submap->T_odom_submap;
    const Eigen::Matrix3f R = T.rotation.toRotationMatrix().cast<float>();
    const Eigen::Vector3f t = T.translation.cast<float>();
    // Neighbours share keyframes.
    std::vector<std::uint32_t> path_index;
    for (const SubmapKeyframe& keyframe : submap->keyframes) {
      if (keyframe.stamp > (stamps.empty() ? core::Time{} : stamps.back())) {
        stamps.push_back(keyframe.stamp);
        place.path.push_back(T * keyframe.T_submap_base);
      }
      const auto found = std::lower_bound(stamps.begin(), stamps.end(), keyframe.stamp);
      path_index.push_back(static_cast<std::uint32_t>(found - stamps.begin()));
    }
    for (Surface surface : submap->surfaces) {
      if (path_index.empty()) break;
      surface.mean = R * surface.mean + t;
      surface.normal = R * surface.normal;
      place.surfaces.push_back(surface);
      place.viewers.push_back(path_index[std::min<std::size_t>(surface.keyframe, path_index.size() - 1)]);
    }
  }
  const DensityImage image(place.surfaces);
  for (const Corner& corner : corners_of(image)) place.features.push_back(describe(image, corner));
  return place;
}

bool is_elsewhere(const core::SE3& a, const core::SE3& b) {
  const core::SE3 d = a.inverse() * b;
  // Cosine of the rotation between them.
  const double w = d.rotation.w();
  return d.translation.norm() > kOtherPlaceMetres || 2.0 * w * w - 1.0 < kOtherPlaceCosine;
}

std::vector<PlanarAlignment> align_features(std::span<const PlaceFeature> reference,
                                            std::span<const PlaceFeature> moving, std::size_t count) {
  const std::vector<Match> matches = match(reference, moving);
  std::vector<PlanarAlignment> all;
  for (std::size_t i = 0; i < matches.size(); ++i) {
    for (std::size_t j = i + 1; j < matches.size(); ++j) {
      const float base = (matches[i].moving - matches[j].moving).norm();
      const float other = (matches[i].reference - matches[j].reference).norm();
      if (base < kMinBaseMetres || std::abs(base - other) > kInlierMetres) continue;
      const std::array<const Match*, 2> pair{&matches[i], &matches[j]};
      auto inliers = inliers_of(fit(pair), matches);
      if (inliers.size() < 4) continue;
      const Planar refined = fit(inliers);
      inliers = inliers_of(refined, matches);
      all.push_back({to_space(refined), static_cast<std::uint32_t>(inliers.size())});
    }
  }
  std::stable_sort(all.begin(), all.end(),
                   [](const PlanarAlignment& a, const PlanarAlignment& b) { return a.inliers > b.inliers; });
  std::vector<PlanarAlignment> best;
  for (const PlanarAlignment& alignment : all) {
    if (best.size() >= count) break;
    const bool is_new = std::all_of(best.begin(), best.end(), [&](const PlanarAlignment& other) {
      return is_elsewhere(alignment.T_reference_moving, other.T_reference_moving);
    });
    if (is_new) best.push_back(alignment);
  }
  return best;
}

}  // namespace nilio::mapping
