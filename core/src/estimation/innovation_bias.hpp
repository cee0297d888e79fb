#pragma once

#include "nilio/core/se3.hpp"

namespace nilio::core {

/// Innovation of a registered pose, weighted: with the prediction's covariance P and the scan's information H
/// the innovation v has covariance S = P + H^-1, which need not exist.
struct WeightedInnovation {
  Vector6 score = Vector6::Zero();        ///< S^-1 v, in axes of base_link
  Matrix6 information = Matrix6::Zero();  ///< S^-1, the covariance of the score
};

/// Score test of the innovations across the way: those of a sound IMU average out, whatever their size. A
/// wrong mounting, wrong axes, or a platform that moves beneath the vehicle, as a ship does, push the pose in
/// one direction scan after scan. Along the way a tunnel or other vehicles do so to a sound IMU, too.
class InnovationBias {
 public:
  void add(const WeightedInnovation& innovation);
  /// Whether the innovations along an axis are biased, by six standard deviations of their sum.
  [[nodiscard]] bool is_significant() const;

 private:
  // Along base_link's y and z.
  Eigen::Vector2d score_ = Eigen::Vector2d::Zero();
  Eigen::Vector2d information_ = Eigen::Vector2d::Zero();
};

}  // namespace nilio::core
