#pragma once

#include "nilio/core/odometry_config.hpp"
#include "nilio/core/odometry_result.hpp"

#include "core/src/estimation/motion_estimator.hpp"
#include "core/src/map/local_map.hpp"
#include "core/src/preprocessing/beam_calibration.hpp"
#include "core/src/preprocessing/normal_space_sampling.hpp"
#include "core/src/registration/methods.hpp"
#include "core/src/stage_clock.hpp"

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace nilio::core {

/// Metric of a guess whose points are off by `sigma_m` everywhere.
[[nodiscard]] PlaneMetric plane_metric(double sigma_m);
/// Metric of the filter's prediction.
[[nodiscard]] PlaneMetric metric_of(const MotionFilter& prediction);

/// A registered sweep, and what its pose rests on.
struct Alignment {
  RegistrationResult registration;  ///< of base_link at the midpoint of the sweep
  std::size_t points = 0;           ///< registered
  /// Share of the points wanted for registration that known voxels hold.
  double known_share = 0.0;
  bool with_coarse = false;  ///< NDT was due
  /// Found by relocalisation: the step to it is no motion of this scan.
  bool relocalized = false;
  bool by_ndt = false;      ///< the pose of NDT was kept
  bool only_ndt = false;    ///< and no prior held it
  int fine_iterations = 0;  ///< of ICP in the whole scan
  bool awaits_map = false;  ///< the map has not taken the sweep yet

  [[nodiscard]] const SE3& pose() const { return registration.T_map_moving; }
  [[nodiscard]] bool has_converged() const { return registration.stop_reason == StopReason::kConverged; }
  /// The budget ended before the first iteration: the registration is no evidence.
  [[nodiscard]] bool had_no_time() const {
    return registration.stop_reason == StopReason::kBudget && registration.iterations == 0;
  }
  [[nodiscard]] bool has_pose() const {
    return pose().is_finite() && registration.stop_reason != StopReason::kTooFewPoints &&
           registration.stop_reason != StopReason::kNonFinite && !had_no_time();
  }
  /// Number of points that agree with the map, each as its residual tells.
  [[nodiscard]] double agreement() const { return has_pose() ? registration.equations.agreement : 0.0; }
  /// Mean of it over the registered points, 0 to 1.
  [[nodiscard]] double mean_agreement() const {
    return points == 0 ? 0.0 : agreement() / static_cast<double>(points);
  }
  /// Copies counts of points to the result of the scan.
  void count(OdometryResult& result) const;
};

/// Where a registration begins.
struct AlignmentStart {
  SE3 T_map_guess;
  PlaneMetric metric;
  bool coarse = false;
  bool relocalized = false;
};

/// Whether the pose of a registration is usable, also if the budget ended before convergence.
bool has_found_pose(const RegistrationResult& registration);

/// The loop of NI-LIO (3.2, 3.3): deskew, NDT, point-to-plane ICP, repeated until the motion settles; or one
/// of the methods that the paper compares it with. Not thread-safe, but uses the threads of the arena it runs
/// in.
class NdtIcp {
 public:
  /// `budget` must outlive it.
  NdtIcp(const OdometryConfig& config, ComputeBudget& budget, StageClock clock);

  [[nodiscard]] const RegistrationMethodInfo& method() const { return method_; }

  /// Selects the points of a sweep to register, by the normals of the map at a guess of the pose at its
  /// midpoint.
  void select(const std::vector<SweepPoint>& sweep, const SweepMotion& motion, const LocalMap& map,
              const SE3& T_map_guess, bool coarse);
  [[nodiscard]] std::size_t selected() const { return selected_sweep_.size(); }

  /// Registers the selected points; the motion over the sweep follows. `result` counts passes and iterations.
  Alignment align(const LocalMap& map, MotionEstimator& motion, const AlignmentStart& start,
                  OdometryResult& result);
  /// Registers deskewed points from a hypothesis, with no prior: by NDT to a tenth of a metre, where the
  /// method has it.
  RegistrationResult register_roughly(const LocalMap& map, std::span<const Eigen::Vector3f> points,
                                      const SE3& T_map_hypothesis, double sigma_m, OdometryResult& result);
  /// The same, then by the method.
  RegistrationResult align_roughly(const LocalMap& map, std::span<const Eigen::Vector3f> points,
                                   const SE3& T_map_hypothesis, double sigma_m, OdometryResult& result);

  /// The registered points and the map without them tell the errors of the beams.
  void add_residuals(const LocalMap& map, const MotionEstimator& motion, const Alignment& alignment,
                     const SE3& T_base_lidar, BeamCalibration& calibration);

 private:
  RegistrationResult register_coarse(const LocalMap& map, RegistrationResult& registration,
                                     OdometryResult& result);
  RegistrationResult register_fine(const LocalMap& map, std::span<const Eigen::Vector3f> points,
                                   const SE3& T_map_guess, const PlaneMetric& metric,
                                   const SolverOptions& options, OdometryResult& result);
  [[nodiscard]] bool has_few(const RegistrationResult& fine, const RegistrationResult& coarse,
                             const MotionEstimator& motion) const;
  [[nodiscard]] RegistrationResult kept_coarse(const LocalMap& map, RegistrationResult coarse,
                                               const PlaneMetric& metric, const SolverOptions& options,
                                               bool had_no_time);
  [[nodiscard]] SolverOptions solver_options() const;
  [[nodiscard]] SolverOptions solver_options(const MotionEstimator& motion) const;
  [[nodiscard]] SweepProblem sweep_problem(const MotionEstimator& motion);

  const RegistrationMethodInfo& method_;
  ComputeBudget& budget_;
  StageClock clock_;
  std::size_t max_points_;
  int max_passes_;
  int max_coarse_iterations_;
  int max_fine_iterations_;
  NormalSpaceSampler sampler_;
  double known_share_ = 0.0;

  // Scratch: candidates and the selected ones.
  VoxelDownsampler downsampler_;
  std::vector<Eigen::Vector3f> deskewed_;
  std::vector<std::uint32_t> selection_;
  std::vector<SweepPoint> selected_sweep_;
  std::vector<Eigen::Vector3f> selected_;
  std::vector<float> point_times_;  ///< of the selected points from the sweep's midpoint, s
  std::vector<Eigen::Vector3f> coarse_points_;
};

}  // namespace nilio::core
