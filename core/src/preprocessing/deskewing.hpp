#pragma once

#include "nilio/core/se3.hpp"
#include "nilio/core/time.hpp"

#include "core/src/estimation/imu_buffer.hpp"
#include "core/src/preprocessing/scan_filter.hpp"

#include <array>
#include <vector>

namespace nilio::core {

/// Cells of equal time in a sweep; inside a cell the motion is first order.
inline constexpr std::size_t kSweepCells = 128;

/// Motion of base_link from the previous pose to the end of the scan: rotation from the gyroscope (or at a
/// constant rate) and a constant velocity in body axes. Registration refines it; deskewing reads it.
class MotionModel {
 public:
  /// Time span of the motion and, inside it, of the sweep.
  struct Span {
    Time previous;  ///< time of the previous pose
    Time start;     ///< first firing
    Time end;       ///< last firing: time of the pose
  };

  /// Rotation from bias-corrected angular velocities of the buffer, which must cover the span.
  void set_rotation_from_imu(const Span& span, const ImuBuffer& imu, const Vector3& gyro_bias);
  /// Rotation at a constant rate in body axes, rad/s.
  void set_constant_rotation(const Span& span, const Vector3& angular_velocity);

  /// Predicts the motion from the rotation as set and a constant body velocity, m/s. Returns T_previous_end.
  SE3 predict(const Vector3& body_velocity);
  /// Motion from the midpoint of the sweep to its end.
  [[nodiscard]] SE3 T_middle_end() const;
  /// Mean twist between the midpoints of two sweeps in body axes, for a scan deskewed with this motion and
  /// registered at T_previous_end, after one whose T_middle_end() was `previous_T_middle_end`. Deskewing with
  /// a wrong motion shifts the end of a sweep but hardly its midpoint; a twist between ends would oscillate.
  [[nodiscard]] Vector6 measure(const SE3& T_previous_end, const SE3& previous_T_middle_end,
                                double previous_sweep_s) const;
  /// Time between those midpoints, seconds.
  [[nodiscard]] double between_s(double previous_sweep_s) const {
    return duration_s() + 0.5 * (previous_sweep_s - sweep_s_);
  }
  /// Sets the twist (its rotation only without a gyro). Returns T_previous_end with the midpoint of the sweep
  /// unchanged and the end that follows from the new motion.
  SE3 refine(const SE3& T_previous_end, const Vector6& twist);
  /// Duration of the sweep, seconds.
  [[nodiscard]] double sweep_s() const { return sweep_s_; }
  /// Velocity in use, m/s in body axes, and mean angular velocity over the span, rad/s.
  [[nodiscard]] const Vector3& body_velocity() const { return body_velocity_; }
  [[nodiscard]] Vector3 mean_angular_velocity() const;

  /// Moves each point to the frame of base_link at the end of the scan. `output` is resized to `points`.
  void deskew(const std::vector<SweepPoint>& points, std::vector<Eigen::Vector3f>& output) const;

 private:
  struct Node {
    Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();  ///< R_previous_node as predicted
    double time_s = 0.0;                                           ///< since the previous pose
  };
  struct Cell {
    Eigen::Matrix3f rotation;  ///< R_end_t at the cell's middle
    Eigen::Vector3f translation;
    Eigen::Vector3f angular_velocity;  ///< of base_link in body axes, rad/s
    Eigen::Vector3f velocity;          ///< of base_link in body axes, m/s
  };

  [[nodiscard]] double duration_s() const { return nodes_.back().time_s; }
  [[nodiscard]] Eigen::Quaterniond corrected_rotation(const Node& node) const;
  /// Integral of the rotation over the span: translation = integral * body velocity.
  [[nodiscard]] Matrix3 rotation_integral(std::size_t first_node = 0) const;
  void build_cells();

  // Nodes: the previous pose, then the sweep's cell borders (so that gaps before the sweep are one long
  // step).
  std::array<Node, kSweepCells + 2> nodes_{};
  Vector3 rotation_correction_ = Vector3::Zero();  ///< body axes, over the whole span
  bool follows_gyro_ = false;
  Vector3 body_velocity_ = Vector3::Zero();
  double sweep_s_ = 0.0;
  std::array<Cell, kSweepCells> cells_{};
};

}  // namespace nilio::core
