#pragma once

#include "nilio/core/result.hpp"

#include "tools/simulate/vehicle/vehicle_trajectory.hpp"

#include <cstdint>
#include <vector>

namespace nilio::tools::simulate {

using Vector2 = Eigen::Vector2d;

/// Unit vector at `angle_rad` from x, and the one to its left.
Vector2 direction(double angle_rad);
Vector2 left_of(const Vector2& direction);

/// Ground plan of an object: a rectangle, x along `yaw_rad`.
struct Footprint {
  Vector2 centre = Vector2::Zero();
  double yaw_rad = 0.0;
  double length_m = 0.0;
  double width_m = 0.0;
};

/// Uses of a cell of the ground plan, as bits.
namespace cell_use {
inline constexpr std::uint8_t kDriven = 1;  ///< the swept area of the vehicle
inline constexpr std::uint8_t kLane = 2;    ///< that lane and the oncoming one
inline constexpr std::uint8_t kRoad = 4;    ///< from kerb to kerb
inline constexpr std::uint8_t kTaken = 8;   ///< an object
}  // namespace cell_use

/// One sample of the driven path, every half metre.
struct StreetSample {
  /// Time at which the vehicle is there; the drive's first or last time beyond its ends.
  double time_s = 0.0;
  Vector2 position = Vector2::Zero();
  double z = 0.0;
  double yaw_rad = 0.0;
  double curvature = 0.0;
  /// Slope of the ground under the vehicle along world x and y.
  Vector2 slope = Vector2::Zero();
  /// Distances from the path to the kerbs.
  double right_edge_m = 2.3;
  double left_edge_m = 5.6;
  /// False beyond the ends of the drive, where the street continues straight.
  bool driven = true;
  /// False where an earlier sample passed the same piece of street in either direction: it gets no second set
  /// of buildings.
  bool first_pass = true;

  /// Point `left_m` to the left of the path.
  [[nodiscard]] Vector2 beside(double left_m) const {
    return position + left_m * left_of(direction(yaw_rad));
  }
};

/// A street that crosses the driven one.
struct SideStreet {
  std::size_t sample = 0;
  /// Half of its length.
  double reach_m = 48.0;
};

inline constexpr double kSampleSpacingM = 0.5;
inline constexpr double kOncomingLaneM = 3.5;
inline constexpr double kSideStreetHalfWidthM = 3.7;

/// Ground plan around a drive: the driven path, the road, and the free space. One thread places objects;
/// afterwards it is read-only.
class StreetLayout {
 public:
  /// Fails when the drive spans too large an area to be simulated.
  static core::Result<StreetLayout> create(const VehicleTrajectory& trajectory, std::uint64_t seed);

  [[nodiscard]] const std::vector<StreetSample>& samples() const { return samples_; }
  [[nodiscard]] const std::vector<SideStreet>& side_streets() const { return side_streets_; }

  /// Uses of the cell at a place; 0 outside the plan.
  [[nodiscard]] std::uint8_t use_at(const Vector2& p) const;
  /// Whether no cell under the footprint, grown by `margin_m` on each side, has one of `uses`; false outside
  /// the plan.
  [[nodiscard]] bool is_free(const Footprint& footprint, std::uint8_t uses, double margin_m) const;
  /// Marks the cells under the footprint.
  void mark(const Footprint& footprint, std::uint8_t uses);

 private:
  StreetLayout() = default;
  core::Result<bool> allocate_cells();
  void choose_edges(std::uint64_t seed);
  void choose_side_streets(std::uint64_t seed);
  void mark_streets();
  template <class Visit>
  void for_each_cell(const Footprint& footprint, Visit visit) const;

  std::vector<StreetSample> samples_;
  std::vector<SideStreet> side_streets_;
  Vector2 origin_ = Vector2::Zero();
  std::int64_t columns_ = 0;
  std::int64_t rows_ = 0;
  std::vector<std::uint8_t> cells_;
};

}  // namespace nilio::tools::simulate
