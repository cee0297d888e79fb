#include "tools/bench/odometry/consistency.hpp"

#include <optional>
#include <utility>

#include <Eigen/Cholesky>

namespace nilio::tools::bench {

namespace {

using core::Matrix6;
using core::OdometryResult;
using core::SE3;
using core::Vector6;

// 95 % quantile of the chi-square distribution with six degrees of freedom.
constexpr double kWithin95 = 12.592;
constexpr double kDegreesOfFreedom = 6.0;
constexpr core::Duration kMaxGap = core::Duration::from_milliseconds(30.0);
constexpr std::size_t kScansPerSecond = 10;

class NeesSum {
 public:
  void add(const Vector6& error, const Matrix6& covariance) {
    const double square = error.dot(covariance.ldlt().solve(error));
    sum_ += square;
    within_ += square <= kWithin95 ? 1 : 0;
    ++count_;
  }
  [[nodiscard]] Nees result() const {
    if (count_ == 0) return {};
    const auto count = static_cast<double>(count_);
    return {count_, sum_ / (kDegreesOfFreedom * count), static_cast<double>(within_) / count};
  }

 private:
  double sum_ = 0.0;
  std::size_t within_ = 0;
  std::size_t count_ = 0;
};

/// A covariance of the pose in body axes.
Matrix6 body_covariance(const OdometryResult& result, const Matrix6& covariance) {
  const Matrix6 to_body = core::block_rotation(result.T_odom_base.rotation.conjugate().toRotationMatrix());
  return to_body * covariance * to_body.transpose();
}

Matrix6 body_covariance(const OdometryResult& result) {
  return body_covariance(result, result.pose_covariance);
}

/// Error of the motion between two scans, in body axes of the second.
Vector6 error_of_motion(const OdometryResult& from, const SE3& true_from, const OdometryResult& to,
                        const SE3& true_to) {
  const SE3 true_motion = true_from.inverse() * true_to;
  return core::se3_log(true_motion.inverse() * (from.T_odom_base.inverse() * to.T_odom_base));
}

/// Error of the motion between two scans, and its covariance.
std::pair<Vector6, Matrix6> motion_error(const OdometryResult& from, const SE3& true_from,
                                         const OdometryResult& to, const SE3& true_to) {
  const Matrix6 A = core::adjoint(to.T_odom_base.inverse() * from.T_odom_base);
  return {error_of_motion(from, true_from, to, true_to),
          body_covariance(to) + A * body_covariance(from) * A.transpose()};
}

void add_twist(const OdometryResult& result, const SE3& true_start, const SE3& true_end, NeesSum& sum) {
  const double seconds = (result.scan_end - result.scan_start).seconds();
  if (seconds <= 0.0) return;
  const Vector6 true_twist = core::se3_log(true_start.inverse() * true_end) / seconds;
  sum.add(result.twist - true_twist, result.twist_covariance);
}

}  // namespace

bool is_registered(const OdometryResult& result) {
  return result.state != core::TrackingState::kInitialising && !result.predicted;
}

double motion_nees(const OdometryResult& from, const SE3& true_from, const OdometryResult& to,
                   const SE3& true_to) {
  const auto [error, covariance] = motion_error(from, true_from, to, true_to);
  return error.dot(covariance.ldlt().solve(error)) / kDegreesOfFreedom;
}

double drift_nees(const OdometryResult& first, const SE3& true_first, const OdometryResult& last,
                  const SE3& true_last) {
  const Vector6 error = error_of_motion(first, true_first, last, true_last);
  return error.dot(body_covariance(last, last.drift_covariance).ldlt().solve(error)) / kDegreesOfFreedom;
}

Consistency evaluate_consistency(const Trajectory& truth, std::span<const OdometryResult> results) {
  NeesSum steps;
  NeesSum seconds;
  NeesSum twists;
  const auto true_at = [&](core::Time stamp) -> std::optional<SE3> {
    if (truth.format != TrajectoryFormat::kTum) return std::nullopt;
    const std::optional<Pose> pose = interpolate_pose(truth, stamp, kMaxGap);
    if (!pose) return std::nullopt;
    return se3_of(*pose);
  };
  const auto add_since = [&](std::size_t before, std::size_t i, const SE3& true_end, NeesSum& sum) {
    if (i < before || !is_registered(results[i - before])) return;
    const std::optional<SE3> true_before = true_at(results[i - before].scan_end);
    if (!true_before) return;
    const auto [error, covariance] = motion_error(results[i - before], *true_before, results[i], true_end);
    sum.add(error, covariance);
  };
  for (std::size_t i = 0; i < results.size(); ++i) {
    if (!is_registered(results[i])) continue;
    const std::optional<SE3> true_start = true_at(results[i].scan_start);
    const std::optional<SE3> true_end = true_at(results[i].scan_end);
    if (!true_start || !true_end) continue;
    add_twist(results[i], *true_start, *true_end, twists);
    add_since(1, i, *true_end, steps);
    add_since(kScansPerSecond, i, *true_end, seconds);
  }
  return {steps.result(), seconds.result(), twists.result()};
}

}  // namespace nilio::tools::bench
