#include "tools/simulate/random.hpp"
#include "tools/simulate/sensors/lidar_shots.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

namespace nilio::tools::simulate {

using core::Vector3;

namespace {

constexpr std::uint64_t kTurnStream = 0x5475726E;
/// Surfaces in a footprint differ if their ranges do by this share.
constexpr float kEdgeShare = 0.03F;
/// Halo of a retroreflector: shots this far beside it take its range.
constexpr double kHaloRad = 0.45 * std::numbers::pi / 180.0;
/// Share of the light that dirt lets through.
constexpr double kDirtTransmission = 0.02;

/// Part of the view that a car's roof, rack and mast hide below an elevation; azimuth from the vehicle's
/// forward direction to the left. Returns of the lowest rings by azimuth in KITTI's raw drive 0009 and
/// sequence 04, which are of one car: mast behind, rack to the right, edge of the roof ahead and to the left.
struct HiddenSector {
  double from_deg;
  double to_deg;
  double below_deg;
};
constexpr std::array kHiddenSectors{HiddenSector{160.0, 167.0, -13.5}, HiddenSector{160.0, 205.0, -17.5},
                                    HiddenSector{150.0, 222.0, -20.5}, HiddenSector{283.0, 300.0, -14.5},
                                    HiddenSector{345.0, 376.0, -20.5}, HiddenSector{340.0, 385.0, -22.0},
                                    HiddenSector{130.0, 222.0, -21.5}};
/// Lower sensors stand on no roof.
constexpr double kRoofM = 1.3;

bool differ(const RayHit& a, const RayHit& b) {
  if (a.hit != b.hit) return true;
  return a.hit &&
         (std::abs(a.distance_m - b.distance_m) > kEdgeShare * std::min(a.distance_m, b.distance_m) ||
          a.material == Material::kFoliage || a.material == Material::kWire ||
          b.material == Material::kFoliage || b.material == Material::kWire);
}

/// Collects single rays to groups.
class RayQueue {
 public:
  using Target = RayHit*;
  RayQueue(const RayScene& scene, float max_range_m, std::span<const NearbyCar> cars)
      : scene_(scene), max_range_m_(max_range_m), cars_(cars) {}

  void add(const Eigen::Vector3f& origin, const Eigen::Vector3f& direction, double time_s, RayHit& target) {
    group_.origin[size_] = origin;
    group_.direction[size_] = direction;
    group_.time_s[size_] = time_s;
    targets_[size_] = &target;
    if (++size_ == kRayGroup) flush();
  }
  void flush() {
    if (size_ == 0) return;
    for (std::size_t i = size_; i < kRayGroup; ++i) {
      group_.origin[i] = group_.origin[0];
      group_.direction[i] = group_.direction[0];
      group_.time_s[i] = group_.time_s[0];
    }
    std::array<RayHit, kRayGroup> hits;
    scene_.cast(group_, max_range_m_, cars_, hits);
    for (std::size_t i = 0; i < size_; ++i) *targets_[i] = hits[i];
    size_ = 0;
  }

 private:
  const RayScene& scene_;
  float max_range_m_;
  std::span<const NearbyCar> cars_;
  RayGroup group_;
  std::array<Target, kRayGroup> targets_{};
  std::size_t size_ = 0;
};

}  // namespace

void LidarModel::cast_footprints(const Motion& motion, const Shots& shots, std::uint64_t packet,
                                 std::size_t first_entry, Footprints& footprints) const {
  for (std::size_t i = 0; i < kRayGroup; ++i) {
    footprints.parts[i][0] = {shots.hits[i], 1.0};
    footprints.count[i] = 1;
  }
  const bool dual = layout_.mode != drivers::ReturnMode::kSingle;
  if (!config_.effects.has(Effect::kFootprint) && !dual) return;
  RayQueue queue(scene_, static_cast<float>(optics_.max_range_m), motion.cars);
  std::array<std::array<FootprintRay, kFootprintRays>, kRayGroup> rays;
  const auto add = [&](std::size_t i, std::size_t k) {
    const Vector3& direction = shots.directions[i];
    const Vector3 aside(-shots.azimuths[i].sin, -shots.azimuths[i].cos, 0.0);
    const Vector3 up = aside.cross(direction);
    const Vector3 ray = (direction + rays[i][k].aside_rad * aside + rays[i][k].up_rad * up).normalized();
    PartialHit& part = footprints.parts[i][k];
    part.share = rays[i][k].share;
    queue.add(shots.rays.origin[i], (shots.R_world_lidar[i] * ray).cast<float>(), shots.rays.time_s[i],
              part.hit);
  };
  // Two opposite rays of the hexagon find the footprints that are not on one surface.
  constexpr std::size_t kProbe = 1;
  constexpr std::size_t kOppositeProbe = 4;
  for (std::size_t i = 0; i < kRayGroup; ++i) {
    const double turn = 2.0 * std::numbers::pi *
                        to_unit_interval(random_word(config_.seed ^ kTurnStream, packet, first_entry + i));
    rays[i] = footprint_rays(optics_, turn);
    add(i, kProbe);
    add(i, kOppositeProbe);
  }
  queue.flush();
  for (std::size_t i = 0; i < kRayGroup; ++i) {
    const auto& parts = footprints.parts[i];
    if (!differ(parts[0].hit, parts[kProbe].hit) && !differ(parts[0].hit, parts[kOppositeProbe].hit))
      continue;
    footprints.parts[i][0].share = rays[i][0].share;
    footprints.count[i] = kFootprintRays;
    for (std::size_t k = 1; k < kFootprintRays; ++k) {
      if (k != kProbe && k != kOppositeProbe) add(i, k);
    }
  }
  queue.flush();
}

Returns LidarModel::real_echoes(const Motion& motion, const Shots& shots, Footprints& footprints,
                                std::size_t i, std::uint64_t word) const {
  const auto passes = transmission(shots.directions[i]);
  if (!passes) return {};
  if (config_.effects.has(Effect::kRetro)) add_halo(motion, shots, i, word, footprints.parts[i][0]);
  ReceivedShot shot;
  shot.nominal = &beams_[shots.lasers[i]];
  shot.laser = shots.lasers[i];
  shot.azimuth = shots.azimuths[i];
  shot.time = core::Duration::from_seconds(shots.rays.time_s[i]);
  shot.word = word;
  shot.transmission = *passes;
  return receiver_->receive(std::span(footprints.parts[i]).first(footprints.count[i]), shot);
}

void LidarModel::add_halo(const Motion& motion, const Shots& shots, std::size_t i, std::uint64_t word,
                          PartialHit& middle) const {
  const Eigen::Vector3f& origin = shots.rays.origin[i];
  const Eigen::Vector3f& direction = shots.rays.direction[i];
  for (const Retroreflector& retro : motion.retroreflectors) {
    const Eigen::Vector3f to = retro.centre - origin;
    const float distance = to.norm();
    if (middle.hit.hit && middle.hit.distance_m < distance + 0.5F) continue;
    const float along = to.dot(direction);
    if (along <= 0.0F) continue;
    const double beside = std::acos(std::min(1.0, static_cast<double>(along / distance)));
    const double edge = beside - static_cast<double>(retro.radius_m / distance);
    if (edge > kHaloRad || edge < 0.0) continue;
    const double strength = std::exp(-4.0 * edge * edge / (kHaloRad * kHaloRad));
    if (to_unit_interval(mix_bits(word ^ 21U)) > strength) continue;
    RayHit seen;
    RayQueue queue(scene_, static_cast<float>(optics_.max_range_m), motion.cars);
    queue.add(origin, to / distance, shots.rays.time_s[i], seen);
    queue.flush();
    if (!seen.hit || seen.material != Material::kRetroreflector) continue;
    middle.hit = seen;
    middle.share = 0.3;
    return;
  }
}

std::optional<double> LidarModel::transmission(const Vector3& direction) const {
  const bool masked =
      config_.effects.has(Effect::kOwnVehicle) && config_.T_base_lidar.translation.z() > kRoofM;
  if (!masked && config_.dirt_deg <= 0.0) return 1.0;
  const Vector3 in_base = config_.T_base_lidar.rotation * direction;
  const double degrees = 180.0 / std::numbers::pi;
  const double azimuth = std::atan2(in_base.y(), in_base.x()) * degrees;
  if (masked) {
    const double elevation = std::asin(std::clamp(in_base.z(), -1.0, 1.0)) * degrees;
    for (const HiddenSector& sector : kHiddenSectors) {
      const double turn = azimuth < sector.from_deg ? azimuth + 360.0 : azimuth;
      if (elevation < sector.below_deg && turn >= sector.from_deg && turn <= sector.to_deg)
        return std::nullopt;
    }
  }
  return std::abs(azimuth) < 0.5 * config_.dirt_deg ? kDirtTransmission : 1.0;
}

}  // namespace nilio::tools::simulate
