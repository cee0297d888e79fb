#pragma once

#include <cstdint>
#include <utility>
#include <vector>

#include "mapping/loops/place.hpp"

namespace nilio::mapping {

/// Structure of a place on a horizontal grid of 1 m, smoothed: how likely structure is seen in each cell.
class PlaceImage {
 public:
  PlaceImage() : cells_(kSize * kSize, 0) {}
  explicit PlaceImage(const Place& place);

  static constexpr int kHalf = 72;
  static constexpr int kSize = 2 * kHalf;

  /// The middle cell; a cell with offsets of less than kHalf along x and y is `y * kSize + x` behind it.
  [[nodiscard]] const std::uint8_t* middle() const { return &cells_[kHalf * kSize + kHalf]; }
  /// Cells in steps of 2 m that a vehicle on the mapped road can be in: near the path, within kReach.
  [[nodiscard]] const std::vector<Eigen::Vector2i>& positions() const { return positions_; }
  /// The first submap of a map begins this far from its middle.
  static constexpr int kReach = 26;
  static constexpr int kStep = 2;
  /// Mean and standard deviation of the cells.
  [[nodiscard]] double mean() const { return mean_; }
  [[nodiscard]] double deviation() const { return deviation_; }

 private:
  std::vector<std::uint8_t> cells_;
  std::vector<Eigen::Vector2i> positions_;
  double mean_ = 0.0;
  double deviation_ = 0.0;
};

/// Structure of recent data, to be compared with images at all headings.
class PlaceTemplate {
 public:
  explicit PlaceTemplate(const Place& place);

  struct Match {
    double score = 0.0;  ///< correlation with the image
    core::SE3 T_image_template;
  };
  /// Horizontal alignments with the middle of the template on a position of the image that are local maxima
  /// of the score: distinct ones, best first. All are tried, so that the result does not depend on chance,
  /// and structure that repeats gives an alignment for each repetition.
  [[nodiscard]] std::vector<Match> find_in(const PlaceImage& image) const;

 private:
  struct Cell {
    Eigen::Vector2f position = Eigen::Vector2f::Zero();
    std::int32_t weight = 0;
  };
  /// Place of a cell behind the middle of an image, and its weight.
  using ImageCell = std::pair<std::int32_t, std::int32_t>;
  struct Heading {
    core::SE3 rotation;
    std::vector<ImageCell> cells;
  };
  [[nodiscard]] std::vector<ImageCell> turned(const core::SE3& rotation) const;

  std::vector<Cell> cells_;
  double norm_ = 1.0;  ///< of the weights
  double sum_ = 0.0;
  std::vector<Heading> headings_;
};

}  // namespace nilio::mapping
