#include "mapping/localisation/place_image.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numbers>
#include <utility>

namespace nilio::mapping {

namespace {

using core::SE3;
using Eigen::Vector2f;

constexpr float kCellMetres = 1.0F;
// Structure farther from the path is seen by few beams.
constexpr float kNearMetres = 30.0F;
constexpr int kMaxOccupied = 4;  ///< cells of a column that count
constexpr std::size_t kMaxCells = 400;
constexpr int kHeadings = 72;
// Lanes of a road, and half a step.
constexpr double kBesideMetres = 9.0;
// A template of this radius fits into an image at every position.
constexpr float kMaxRadius = static_cast<float>(PlaceImage::kHalf - PlaceImage::kReach - 2);
constexpr std::size_t kMatches = 12;
// A match below this share of the best one is no rival of it.
constexpr double kMinScoreShare = 0.5;

/// Occupied cells of 1 m in each column near the path, by row and column.
std::map<std::pair<int, int>, int> columns_of(const Place& place) {
  std::map<std::pair<int, int>, std::uint32_t> heights;
  for (const Surface& surface : place.surfaces) {
    if (!is_structure(surface)) continue;
    const bool is_near = std::any_of(place.path.begin(), place.path.end(), [&](const SE3& pose) {
      return (pose.translation.head<2>().cast<float>() - surface.mean.head<2>()).squaredNorm() <
             kNearMetres * kNearMetres;
    });
    if (!is_near) continue;
    const Eigen::Vector3i cell = (surface.mean / kCellMetres).array().floor().cast<int>();
    heights[{cell.y(), cell.x()}] |= 1U << static_cast<unsigned>(std::clamp(cell.z() + 8, 0, 31));
  }
  std::map<std::pair<int, int>, int> columns;
  for (const auto& [cell, bits] : heights)
    columns[cell] = std::min(kMaxOccupied, static_cast<int>(__builtin_popcount(bits)));
  return columns;
}

}  // namespace

PlaceImage::PlaceImage(const Place& place) : PlaceImage() {
  std::vector<int> counts(cells_.size(), 0);
  for (const auto& [cell, count] : columns_of(place)) {
    const auto& [y, x] = cell;
    if (std::abs(x) >= kHalf - 1 || std::abs(y) >= kHalf - 1) continue;
    counts[static_cast<std::size_t>((y + kHalf) * kSize + x + kHalf)] = count;
  }
  for (int y = -kReach; y <= kReach; y += kStep) {
    for (int x = -kReach; x <= kReach; x += kStep) {
      const bool is_near = std::any_of(place.path.begin(), place.path.end(), [&](const SE3& pose) {
        return (pose.translation.head<2>() - core::Vector3(x, y, 0.0).head<2>()).squaredNorm() <
               kBesideMetres * kBesideMetres;
      });
      if (is_near) positions_.emplace_back(x, y);
    }
  }
  // Binomial filter of three cells along both axes: a template turned and shifted by half a step still fits.
  double sum = 0.0;
  double squares = 0.0;
  for (int y = 1; y + 1 < kSize; ++y) {
    for (int x = 1; x + 1 < kSize; ++x) {
      int value = 0;
      for (int k = 0; k < 9; ++k) {
        const int dx = k % 3 - 1;
        const int dy = k / 3 - 1;
        const int weight = (2 - std::abs(dx)) * (2 - std::abs(dy));
        value += weight * counts[static_cast<std::size_t>((y + dy) * kSize + x + dx)];
      }
      // At most 16 * 4.
      cells_[static_cast<std::size_t>(y * kSize + x)] = static_cast<std::uint8_t>(std::min(3 * value, 96));
      const int cell = cells_[static_cast<std::size_t>(y * kSize + x)];
      sum += cell;
      squares += cell * cell;
    }
  }
  const auto count = static_cast<double>(cells_.size());
  mean_ = sum / count;
  deviation_ = std::sqrt(std::max(1.0, squares / count - mean_ * mean_));
}

PlaceTemplate::PlaceTemplate(const Place& place) {
  for (const auto& [cell, count] : columns_of(place)) {
    const Vector2f p =
        kCellMetres * Vector2f(static_cast<float>(cell.second) + 0.5F, static_cast<float>(cell.first) + 0.5F);
    if (p.norm() < kMaxRadius * kCellMetres) cells_.push_back({p, count});
  }
  // Tall structure is seen from everywhere.
  std::stable_sort(cells_.begin(), cells_.end(),
                   [](const Cell& a, const Cell& b) { return a.weight > b.weight; });
  if (cells_.size() > kMaxCells) cells_.resize(kMaxCells);
  double squares = 0.0;
  for (const Cell& cell : cells_) {
    squares += cell.weight * cell.weight;
    sum_ += cell.weight;
  }
  norm_ = std::sqrt(std::max(1.0, squares));
  for (int i = 0; i < kHeadings; ++i) {
    Heading heading;
    heading.rotation.rotation = core::so3_exp({0.0, 0.0, 2.0 * std::numbers::pi * i / kHeadings});
    heading.cells = turned(heading.rotation);
    headings_.push_back(std::move(heading));
  }
}

std::vector<PlaceTemplate::ImageCell> PlaceTemplate::turned(const SE3& rotation) const {
  std::vector<ImageCell> result;
  const Eigen::Matrix2f R = rotation.rotation.toRotationMatrix().topLeftCorner<2, 2>().cast<float>();
  for (const Cell& cell : cells_) {
    const Eigen::Vector2i p = (R * cell.position / kCellMetres).array().floor().cast<int>();
    result.emplace_back(p.y() * PlaceImage::kSize + p.x(), cell.weight);
  }
  return result;
}

std::vector<PlaceTemplate::Match> PlaceTemplate::find_in(const PlaceImage& image) const {
  constexpr int kSteps = PlaceImage::kReach / PlaceImage::kStep;
  constexpr std::size_t kSide = 2 * kSteps + 3;
  const double offset = image.mean() * sum_;
  const double scale = 1.0 / (image.deviation() * norm_ * std::sqrt(static_cast<double>(cells_.size() + 1)));
  const auto index_of = [](const Eigen::Vector2i& position) {
    const Eigen::Vector2i step = position / PlaceImage::kStep;
    return static_cast<std::size_t>(step.y() + kSteps + 1) * kSide +
           static_cast<std::size_t>(step.x() + kSteps + 1);
  };
  std::vector<Match> all;
  for (const Heading& heading : headings_) {
    // With a margin; 0 where no vehicle can be.
    std::array<std::int32_t, kSide * kSide> products{};
    for (const Eigen::Vector2i& position : image.positions()) {
      const std::uint8_t* const origin = image.middle() + position.y() * PlaceImage::kSize + position.x();
      std::int32_t product = 0;
      for (const auto& [cell, weight] : heading.cells) product += weight * origin[cell];
      products[index_of(position)] = product;
    }
    for (const Eigen::Vector2i& position : image.positions()) {
      const std::size_t i = index_of(position);
      bool is_maximum = products[i] > offset;
      for (const std::size_t row : {i - kSide, i, i + kSide}) {
        for (const std::size_t k : {row - 1, row, row + 1})
          is_maximum = is_maximum && products[k] <= products[i];
      }
      if (!is_maximum) continue;
      Match match{(products[i] - offset) * scale, heading.rotation};
      match.T_image_template.translation.head<2>() =
          static_cast<double>(kCellMetres) * position.cast<double>();
      all.push_back(match);
    }
  }
  std::stable_sort(all.begin(), all.end(), [](const Match& a, const Match& b) { return a.score > b.score; });
  std::vector<Match> matches;
  for (const Match& match : all) {
    if (matches.size() >= kMatches || match.score < kMinScoreShare * all.front().score) break;
    const bool is_new = std::all_of(matches.begin(), matches.end(), [&](const Match& other) {
      return is_elsewhere(match.T_image_template, other.T_image_template);
    });
    if (is_new) matches.push_back(match);
  }
  return matches;
}

}  // namespace nilio::mapping
