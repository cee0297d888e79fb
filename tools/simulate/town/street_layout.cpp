#include "tools/simulate/town/street_layout.hpp"

#include "tools/simulate/random.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <unordered_map>

namespace nilio::tools::simulate {

namespace {

using core::SE3;
using core::Vector3;

constexpr double kCellM = 0.5;
constexpr double kMarginM = 100.0;
/// 200 million cells of half a metre: a square of 7 km.
constexpr double kMaxCells = 2e8;
/// Half of a car's width plus the clearance that a driver keeps.
constexpr double kDrivenHalfWidthM = 1.7;
constexpr double kStreetEndM = 60.0;
/// Length of street between changes of its profile (parking strips, parks).
constexpr double kSectionLengthM = 70.0;

StreetSample make_sample(const SE3& T_world_base, double time_s) {
  const Vector3 forward = T_world_base.rotation * Vector3::UnitX();
  const Vector3 up = T_world_base.rotation * Vector3::UnitZ();
  StreetSample sample;
  sample.time_s = time_s;
  sample.position = T_world_base.translation.head<2>();
  sample.z = T_world_base.translation.z();
  sample.yaw_rad = std::atan2(forward.y(), forward.x());
  sample.slope = -up.head<2>() / std::max(up.z(), 0.5);
  return sample;
}

/// Straight pieces before the first (`way` -1) or after the last sample (+1), nearest first.
std::vector<StreetSample> extend(const StreetSample& end, double way) {
  std::vector<StreetSample> result;
  for (double d = kSampleSpacingM; d < kStreetEndM; d += kSampleSpacingM) {
    StreetSample sample = end;
    sample.position += way * d * direction(end.yaw_rad);
    sample.driven = false;
    result.push_back(sample);
  }
  return result;
}

std::vector<StreetSample> sample_path(const VehicleTrajectory& trajectory) {
  constexpr double time_step_s = 0.01;
  std::vector<StreetSample> driven{make_sample(trajectory.pose(0.0), 0.0)};
  const auto steps = static_cast<std::size_t>(trajectory.duration_s() / time_step_s);
  for (std::size_t i = 1; i <= steps; ++i) {
    const double time_s = static_cast<double>(i) * time_step_s;
    const SE3 pose = trajectory.pose(time_s);
    const Vector2 moved = pose.translation.head<2>() - driven.back().position;
    if (moved.norm() >= kSampleSpacingM) driven.push_back(make_sample(pose, time_s));
  }
  std::vector<StreetSample> samples = extend(driven.front(), -1.0);
  std::reverse(samples.begin(), samples.end());
  samples.insert(samples.end(), driven.begin(), driven.end());
  const std::vector<StreetSample> tail = extend(driven.back(), 1.0);
  samples.insert(samples.end(), tail.begin(), tail.end());
  // Over 4 m, so that the body's sway has no effect.
  for (std::size_t i = 4; i + 4 < samples.size(); ++i) {
    const double turn =
        std::remainder(samples[i + 4].yaw_rad - samples[i - 4].yaw_rad, 2.0 * std::numbers::pi);
    samples[i].curvature = turn / (8.0 * kSampleSpacingM);
  }
  return samples;
}

/// Finds the samples on a street that the path has used before.
void find_passes(std::vector<StreetSample>& samples) {
  constexpr double bucket_m = 6.0;
  constexpr double same_street_m = 5.5;
  constexpr std::size_t own_track = 60;
  const auto bucket = [](const Vector2& p, int dx, int dy) {
    const auto x = static_cast<std::int64_t>(std::floor(p.x() / bucket_m)) + dx;
    const auto y = static_cast<std::int64_t>(std::floor(p.y() / bucket_m)) + dy;
    return x * 4'000'037 + y;
  };
  std::unordered_map<std::int64_t, std::vector<std::size_t>> earlier;
  const auto passed_before = [&](std::size_t i) {
    for (int dx = -1; dx <= 1; ++dx) {
      for (int dy = -1; dy <= 1; ++dy) {
        const auto found = earlier.find(bucket(samples[i].position, dx, dy));
        if (found == earlier.end()) continue;
        for (const std::size_t j : found->second) {
          const bool near = (samples[j].position - samples[i].position).norm() < same_street_m;
          const bool parallel = std::abs(std::sin(samples[j].yaw_rad - samples[i].yaw_rad)) < 0.4;
          if (j + own_track < i && near && parallel) return true;
        }
      }
    }
    return false;
  };
  for (std::size_t i = 0; i < samples.size(); ++i) {
    samples[i].first_pass = !passed_before(i);
    earlier[bucket(samples[i].position, 0, 0)].push_back(i);
  }
}

}  // namespace

Vector2 direction(double angle_rad) { return {std::cos(angle_rad), std::sin(angle_rad)}; }

Vector2 left_of(const Vector2& direction) { return {-direction.y(), direction.x()}; }

core::Result<StreetLayout> StreetLayout::create(const VehicleTrajectory& trajectory, std::uint64_t seed) {
  StreetLayout layout;
  layout.samples_ = sample_path(trajectory);
  find_passes(layout.samples_);
  const core::Result<bool> allocated = layout.allocate_cells();
  if (!allocated) return allocated.error();
  layout.choose_edges(seed);
  layout.choose_side_streets(seed);
  layout.mark_streets();
  return layout;
}

core::Result<bool> StreetLayout::allocate_cells() {
  Vector2 low = samples_.front().position;
  Vector2 high = low;
  for (const StreetSample& sample : samples_) {
    low = low.cwiseMin(sample.position);
    high = high.cwiseMax(sample.position);
  }
  const Vector2 size = high - low + Vector2::Constant(2.0 * kMarginM);
  if (size.x() * size.y() / (kCellM * kCellM) > kMaxCells) {
    return core::Error{"the drive spans " + std::to_string(static_cast<int>(size.x() / 1000.0)) + " km by " +
                       std::to_string(static_cast<int>(size.y() / 1000.0)) +
                       " km, too much for one town; take a part of it with --length"};
  }
  origin_ = low - Vector2::Constant(kMarginM);
  columns_ = static_cast<std::int64_t>(std::ceil(size.x() / kCellM));
  rows_ = static_cast<std::int64_t>(std::ceil(size.y() / kCellM));
  cells_.assign(static_cast<std::size_t>(columns_ * rows_), 0);
  return true;
}

void StreetLayout::choose_edges(std::uint64_t seed) {
  for (std::size_t i = 0; i < samples_.size(); ++i) {
    const auto section =
        static_cast<std::uint64_t>(static_cast<double>(i) * kSampleSpacingM / kSectionLengthM);
    const bool narrow = std::abs(samples_[i].curvature) > 0.03 || !samples_[i].first_pass;
    if (narrow) continue;
    if (to_unit_interval(random_word(seed, 21, section)) < 0.6) samples_[i].right_edge_m += 2.1;
    if (to_unit_interval(random_word(seed, 22, section)) < 0.5) samples_[i].left_edge_m += 2.1;
  }
}

void StreetLayout::choose_side_streets(std::uint64_t seed) {
  RandomStream random(seed, 23);
  double next = random.uniform(90.0, 120.0);
  for (std::size_t i = 0; i < samples_.size(); ++i) {
    const bool straight = std::abs(samples_[i].curvature) < 0.01;
    if (static_cast<double>(i) * kSampleSpacingM < next || !straight || !samples_[i].first_pass ||
        !samples_[i].driven) {
      continue;
    }
    side_streets_.push_back({i});
    next = static_cast<double>(i) * kSampleSpacingM + random.uniform(70.0, 130.0);
  }
}

void StreetLayout::mark_streets() {
  using namespace cell_use;
  for (const StreetSample& sample : samples_) {
    // Rectangles longer than the spacing leave no gap on the outside of a bend.
    const auto mark_band = [&](double right, double left, std::uint8_t use) {
      mark({sample.beside(0.5 * (left - right)), sample.yaw_rad, 1.6, left + right}, use);
    };
    mark_band(sample.right_edge_m, sample.left_edge_m, kRoad);
    mark_band(kDrivenHalfWidthM, kOncomingLaneM + kDrivenHalfWidthM, kLane);
    if (sample.driven) mark_band(kDrivenHalfWidthM, kDrivenHalfWidthM, kDriven);
  }
  for (const SideStreet& street : side_streets_) {
    const StreetSample& sample = samples_[street.sample];
    const Footprint band{sample.position, sample.yaw_rad + 0.5 * std::numbers::pi, 2.0 * street.reach_m,
                         2.0 * kSideStreetHalfWidthM};
    mark(band, kRoad | kLane);
  }
}

std::uint8_t StreetLayout::use_at(const Vector2& p) const {
  const auto column = static_cast<std::int64_t>(std::floor((p.x() - origin_.x()) / kCellM));
  const auto row = static_cast<std::int64_t>(std::floor((p.y() - origin_.y()) / kCellM));
  if (column < 0 || row < 0 || column >= columns_ || row >= rows_) return 0;
  return cells_[static_cast<std::size_t>(row * columns_ + column)];
}

template <class Visit>
void StreetLayout::for_each_cell(const Footprint& footprint, Visit visit) const {
  const Vector2 along = direction(footprint.yaw_rad);
  const Vector2 across = left_of(along);
  const Vector2 half(0.5 * footprint.length_m, 0.5 * footprint.width_m);
  const double reach = half.norm() + kCellM;
  const auto low_column =
      static_cast<std::int64_t>(std::floor((footprint.centre.x() - reach - origin_.x()) / kCellM));
  const auto high_column =
      static_cast<std::int64_t>(std::floor((footprint.centre.x() + reach - origin_.x()) / kCellM));
  const auto low_row =
      static_cast<std::int64_t>(std::floor((footprint.centre.y() - reach - origin_.y()) / kCellM));
  const auto high_row =
      static_cast<std::int64_t>(std::floor((footprint.centre.y() + reach - origin_.y()) / kCellM));
  // Half a cell's diagonal: a cell that is only touched counts.
  const double touch = 0.5 * std::numbers::sqrt2 * kCellM;
  for (std::int64_t row = low_row; row <= high_row; ++row) {
    for (std::int64_t column = low_column; column <= high_column; ++column) {
      const Vector2 centre =
          origin_ + kCellM * Vector2(static_cast<double>(column) + 0.5, static_cast<double>(row) + 0.5);
      const Vector2 offset = centre - footprint.centre;
      const bool inside =
          std::abs(offset.dot(along)) <= half.x() + touch && std::abs(offset.dot(across)) <= half.y() + touch;
      if (inside) visit(column, row);
    }
  }
}

bool StreetLayout::is_free(const Footprint& footprint, std::uint8_t uses, double margin_m) const {
  Footprint grown = footprint;
  grown.length_m += 2.0 * margin_m;
  grown.width_m += 2.0 * margin_m;
  bool free = true;
  for_each_cell(grown, [&](std::int64_t column, std::int64_t row) {
    const bool outside = column < 0 || row < 0 || column >= columns_ || row >= rows_;
    free = free && !outside && (cells_[static_cast<std::size_t>(row * columns_ + column)] & uses) == 0;
  });
  return free;
}

void StreetLayout::mark(const Footprint& footprint, std::uint8_t uses) {
  for_each_cell(footprint, [&](std::int64_t column, std::int64_t row) {
    if (column < 0 || row < 0 || column >= columns_ || row >= rows_) return;
    std::uint8_t& cell = cells_[static_cast<std::size_t>(row * columns_ + column)];
    cell = static_cast<std::uint8_t>(cell | uses);
  });
}

}  // namespace nilio::tools::simulate
