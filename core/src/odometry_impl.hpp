#pragma once

#include "nilio/core/odometry.hpp"

#include "core/src/estimation/motion_estimator.hpp"
#include "core/src/map/local_map.hpp"
#include "core/src/preprocessing/preprocessing.hpp"
#include "core/src/recovery/initial_motions.hpp"
#include "core/src/recovery/pose_search.hpp"
#include "core/src/recovery/tracking_gate.hpp"
#include "core/src/registration/ndt_icp.hpp"
#include "core/src/stage_clock.hpp"

#include <vector>

#include <tbb/task_arena.h>

namespace nilio::core {

/// Threads of the registration, and one alone for work too small to share. Results do not depend on it.
struct WorkerThreads {
  tbb::task_arena all;
  tbb::task_arena one{1};
};

/// Parts of the odometry, and its steps in the order of use: odometry.cpp, and recovery/hypotheses.cpp for
/// those that try another motion or pose.
struct Odometry::State {
  State(const OdometryConfig& configuration, ClockFunction clock_function);

  /// Returns how many points were visited.
  std::size_t filter_points(const Scan& scan, OdometryResult& result);
  [[nodiscard]] bool restart_is_due() const;
  void start(const Scan& scan, OdometryResult& result);
  void place_first_sweep(double plane_voxel_m);
  void insert(const std::vector<SweepPoint>& sweep, const PlacedSweep& placed);
  void predict(const Scan& scan, OdometryResult& result);
  void select_points(const SE3& T_map_guess);
  tbb::task_arena& registration_threads();
  void register_sweep(OdometryResult& result);
  void register_predicted(OdometryResult& result);
  void register_at_prediction(OdometryResult& result);
  void align_to_prediction(OdometryResult& result);
  void align(const AlignmentStart& start, OdometryResult& result);
  void check_alignment(OdometryResult& result);
  void finish(OdometryResult& result);
  void update_map();

  // Hypotheses.
  /// A motion of the scan with its alignment.
  struct Hypothesis {
    MotionEstimator::Hypothesis motion;
    Alignment alignment;
    double agreement = 0.0;
  };
  [[nodiscard]] Hypothesis hypothesis() const;
  void return_to(const Hypothesis& earlier, OdometryResult& result);
  void find_initial_motions(OdometryResult& result);
  void refine_initial_motions(OdometryResult& result);
  /// `variance`: m^2/s^2, rad^2/s^2.
  void place_with(const Vector6& twist, const Vector6& variance);
  void begin_with(const Vector6& twist, bool coarse, OdometryResult& result);
  void follow_initial_motions(OdometryResult& result);
  void keep_likely_motions(OdometryResult& result);
  void place_sweeps(const InitialMotion& placed);
  void reconsider_stationary(OdometryResult& result);
  void reconsider_imu(OdometryResult& result);
  void compare_hypotheses(OdometryResult& result);
  void align_anew(OdometryResult& result);
  void relocalize(OdometryResult& result);

  // Results.
  [[nodiscard]] static OdometryResult result_for(const Scan& scan);
  [[nodiscard]] Duration recovery_budget(const Scan& scan) const;
  [[nodiscard]] DegradationLevel degradation_level_of(const OdometryResult& result) const;
  void count_map(OdometryResult& result) const;
  /// Voxel of the points for NDT in the map.
  [[nodiscard]] float coarse_voxel_m() const;
  /// Fills poses, twist, covariances: of a pose at the end of a sweep, from the filter at its midpoint; and
  /// what the gate says about the pose.
  PublishedPose describe(const MotionPrior& prior, const MotionFilter& at_middle, const SweepMotion& moved,
                         const SE3& T_map_base, OdometryResult& result) const;

  const OdometryConfig config;
  const StageClock clock;
  WorkerThreads threads;
  ComputeBudget budget;
  Preprocessing preprocessing;
  MotionEstimator motion;
  LocalMap map;
  NdtIcp ndt_icp;
  PoseSearch search;
  TrackingGate gate;
  Alignment alignment;  ///< of the last scan
  InitialMotions initial_motions;
};

}  // namespace nilio::core
