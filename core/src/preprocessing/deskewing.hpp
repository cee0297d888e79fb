#pragma once

#include "core/src/estimation/motion_filter.hpp"
#include "core/src/preprocessing/scan_filter.hpp"

#include <array>
#include <vector>

namespace nilio::core {

/// Cells of equal time in a sweep; inside a cell the motion is first order: 0.1 mm at 30 m and 90 deg/s.
inline constexpr std::size_t kSweepCells = 32;

/// Time span of a sweep: first and last firing.
struct SweepSpan {
  Time start;
  Time end;

  [[nodiscard]] Time middle() const { return end - (end - start) / 2; }
  [[nodiscard]] double seconds() const { return (end - start).seconds(); }
};

/// Motion of base_link over a sweep, relative to its midpoint, which an error of the velocities hardly moves.
class SweepMotion {
 public:
  SweepMotion() = default;
  /// Integrates forwards and backwards from the state at the midpoint.
  SweepMotion(const SweepSpan& span, const MotionState& at_middle, const MotionInputs& inputs);

  [[nodiscard]] const SweepSpan& span() const { return span_; }
  [[nodiscard]] const SE3& T_middle_end() const { return T_middle_end_; }
  [[nodiscard]] const Vector6& middle_twist() const { return middle_twist_; }
  /// Twist at the end.
  [[nodiscard]] const Vector6& end_twist() const { return end_twist_; }
  /// Moves each point to the frame of base_link at the midpoint. `output` is resized to `points`.
  void deskew(const std::vector<SweepPoint>& points, std::vector<Eigen::Vector3f>& output) const;

 private:
  struct Cell {
    Eigen::Matrix3f rotation = Eigen::Matrix3f::Identity();  ///< R_middle_t at the middle of the cell
    Eigen::Vector3f translation = Eigen::Vector3f::Zero();
    Eigen::Vector3f angular_velocity = Eigen::Vector3f::Zero();  ///< of base_link in its own axes, rad/s
    Eigen::Vector3f velocity = Eigen::Vector3f::Zero();          ///< m/s
  };

  SweepSpan span_;
  SE3 T_middle_end_;
  Vector6 middle_twist_ = Vector6::Zero();
  Vector6 end_twist_ = Vector6::Zero();
  std::array<Cell, kSweepCells> cells_{};
};

}  // namespace nilio::core
