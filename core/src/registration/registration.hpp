#pragma once

#include "nilio/core/compute_budget.hpp"
#include "nilio/core/se3.hpp"
#include "nilio/core/tracking.hpp"

#include "core/src/map/gaussian_voxel_map.hpp"

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace nilio::core {

/// Sums over the correspondences of a linearisation, beside the matrices of NormalEquations.
struct ResidualSums {
  Vector6 b = Vector6::Zero();
  Vector6 b_twist = Vector6::Zero();
  /// Sum of weight * squared residual (m^2 for planes, squared Mahalanobis distance for NDT), and of the
  /// weights.
  double weighted_square_error = 0.0;
  double weight_sum = 0.0;
  /// Part of weighted_square_error by which residuals to Gaussians exceed the point's own deviation: their
  /// spread is no measure of how well planes observe the pose.
  double gaussian_square_excess = 0.0;
  std::uint32_t correspondences = 0;
  /// Correspondences with a residual below the inlier distance.
  std::uint32_t inliers = 0;
  /// Sum of the agreement of correspondences: 1 on the surface, 0 far from it in units of plane thickness and
  /// point deviation; the kernel's weight for point methods.
  double agreement = 0.0;
};

/// Gauss-Newton normal equations H * delta = -b of a perturbation on the right, T <- T * exp(delta),
/// translation first, in axes of the moving frame: well conditioned at any distance from the origin.
struct NormalEquations : ResidualSums {
  Matrix6 H = Matrix6::Zero();
  /// Of the twist over the sweep, beside the pose: a point at the time t from the midpoint moves with it by t
  /// times its motion with the pose.
  Matrix6 H_cross = Matrix6::Zero();
  Matrix6 H_twist = Matrix6::Zero();
  /// H with the weight of each voxel times the share of the newest of its scans, 2 / (scans + 1): as of a
  /// mean that follows them.
  Matrix6 H_newest = Matrix6::Zero();
  /// Part of H that the errors of the planes' normals are expected to add.
  Matrix6 H_normals = Matrix6::Zero();
};

/// Lever that converts rotation errors to distances: a usual range of points.
inline constexpr double kErrorLeverMetres = 30.0;

/// Gate of correspondences in standard deviations.
inline constexpr double kGateSigmas = 3.0;

struct PlaneMetric {
  /// Residuals beyond the gate are not correspondences, metres.
  double gate_m = 1.0;
  /// Scale of the Geman-McClure weight (s^2 / (s^2 + r^2))^2, metres.
  double kernel_scale_m = 0.3;
  /// A voxel is a plane when its smallest eigenvalue is less than this share of the middle one.
  double max_planarity = 0.1;
  /// Residual below which a correspondence counts as an inlier, metres.
  double inlier_distance_m = 0.2;
  /// Deviation of a point from a perfectly known plane, metres: range noise and roughness. The uncertainty of
  /// a plane is weighed against it.
  double point_deviation_m = 0.05;
  /// Weight of non-planar voxels against planes, 0 to 1.
  double gaussian_weight = 1.0;
  /// Covariance of the guess, as in PosePrior. Gate and kernel widen by the deviation that it gives each
  /// residual: a yaw known badly does not open them for points ahead.
  Matrix6 guess_covariance = Matrix6::Zero();

  /// Squared scale of the kernel, m^2, for a residual that the guess gives `variance`.
  [[nodiscard]] double kernel_square(double variance) const {
    return kernel_scale_m * kernel_scale_m + variance;
  }
  /// Squared gate, m^2.
  [[nodiscard]] double gate_square(double variance) const {
    return gate_m * gate_m + kGateSigmas * kGateSigmas * variance;
  }
};

/// Pose and twist of base_link at the midpoint of a sweep, with the joint covariance of their prior.
struct SweepPrior {
  SE3 T_map_middle;
  Vector6 twist = Vector6::Zero();
  Matrix12 covariance = Matrix12::Identity();
};

/// A sweep of which the twist is registered with the pose.
struct SweepProblem {
  std::span<const float> times_s;          ///< of the points, from the midpoint
  Vector6 deskew_twist = Vector6::Zero();  ///< at the midpoint, by which the points are deskewed
  SweepPrior prior;
};

/// Points move from where deskewing put them in proportion to their time.
struct SweepChange {
  const SweepProblem* problem = nullptr;
  Vector6 twist = Vector6::Zero();  ///< since the points were deskewed
};

/// Point-to-plane equations against each point's home voxel (NI-LIO 3.3): r = n . (T p - mean).
/// `points` in the moving frame. The sum has a fixed shape, so it is the same to the last bit at any number
/// of threads. With a `change` also those of the twist.
NormalEquations plane_equations(const VoxelMap& map, std::span<const Eigen::Vector3f> points,
                                const SE3& T_map_moving, const PlaneMetric& metric,
                                const SweepChange& change = {});

struct NdtMetric {
  /// Scale of the Mahalanobis distance in the weight exp(-m^2 / (2 s^2)): large sees far, small is exact.
  double kernel_scale = 2.0;
};

/// Point-to-distribution NDT equations against the home voxel and its six face neighbours (NI-LIO 3.2;
/// Magnusson 2009 eq. 6.9 with the score's exponential as a weight, which makes the Newton step a
/// Gauss-Newton step).
NormalEquations ndt_equations(const VoxelMap& map, std::span<const Eigen::Vector3f> points,
                              const SE3& T_map_moving, const NdtMetric& metric);

/// Prior of a pose.
struct PosePrior {
  SE3 T_map_moving;
  /// Of an error on the right: translation then rotation, in axes of the moving frame; m^2, rad^2. Positive
  /// definite.
  Matrix6 covariance = Matrix6::Identity();
  bool is_measured = false;  ///< by gyro and accelerometer
};

struct SolverOptions {
  int max_iterations = 8;
  double translation_epsilon_m = 2e-3;
  double rotation_epsilon_rad = 2e-4;
  /// Fewer tell no pose.
  std::uint32_t min_correspondences = 30;
  /// Without a prior: directions whose mean squared direction cosine falls below this are not observed.
  double degeneracy_threshold = 0.005;
  /// Combines prior and scan in every direction by their information.
  std::optional<PosePrior> prior;
  /// Registers the twist with the pose; its prior takes the place of the one above.
  const SweepProblem* sweep = nullptr;
  /// Queried before each iteration; null = unlimited.
  ComputeBudget* budget = nullptr;
};

struct RegistrationResult {
  SE3 T_map_moving;
  NormalEquations equations;  ///< at the last linearisation
  StopReason stop_reason = StopReason::kMaxIterations;
  int iterations = 0;
  /// Bit i: axis i (x y z rx ry rz) of the moving frame is closest to a direction that the scan does not
  /// observe.
  std::uint8_t degenerate_axes = 0;
  /// Information of the scan alone, in axes of the moving frame, with the errors that its points share.
  Matrix6 information = Matrix6::Zero();
  /// Share of the step along each axis that the scan decided; 1 without a prior.
  Vector6 observability = Vector6::Ones();
  /// With a sweep: its twist, and the information about pose and twist together; zero otherwise.
  Vector6 twist = Vector6::Zero();
  Matrix12 sweep_information = Matrix12::Zero();
};

/// Variance of a residual of plane_equations(), m^2: H divided by it is the information of the scan.
double measurement_variance(const NormalEquations& equations);

/// ICP: point-to-plane Gauss-Newton with re-association in every iteration.
RegistrationResult register_planes(const VoxelMap& map, std::span<const Eigen::Vector3f> points,
                                   const SE3& T_map_guess, const PlaneMetric& metric,
                                   const SolverOptions& options);

/// NDT with a schedule of kernel scales, wide to narrow: each is iterated until convergence.
RegistrationResult register_ndt(const VoxelMap& map, std::span<const Eigen::Vector3f> points,
                                const SE3& T_map_guess, std::span<const double> kernel_scales,
                                const SolverOptions& options);

}  // namespace nilio::core
