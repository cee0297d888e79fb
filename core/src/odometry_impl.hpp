#pragma once

#include "nilio/core/odometry.hpp"

#include "core/src/estimation/imu_buffer.hpp"
#include "core/src/estimation/motion_filter.hpp"
#include "core/src/estimation/stationary_detector.hpp"
#include "core/src/imu_monitor/imu_monitor.hpp"
#include "core/src/map/gaussian_voxel_map.hpp"
#include "core/src/preprocessing/beam_calibration.hpp"
#include "core/src/preprocessing/deskewing.hpp"
#include "core/src/preprocessing/normal_space_sampling.hpp"
#include "core/src/preprocessing/scan_filter.hpp"
#include "core/src/registration/methods.hpp"

#include <algorithm>
#include <cstdint>
#include <optional>
#include <vector>

#include <tbb/task_arena.h>

namespace nilio::core {

/// Scans until map and velocity are established. Insertion is denser meanwhile, because one downsampled scan
/// leaves too few points per voxel.
inline constexpr std::uint64_t kInitialScans = 5;
/// NDT runs until this many scans observed every axis; after one that did not, until this many in a row do:
/// moving objects must not determine the initial velocity.
inline constexpr int kMinScansWithNdt = 4;
inline constexpr int kScansToBeSure = 20;
inline constexpr float kFirstVoxelShare = 0.5F;
inline constexpr float kInitialVoxelShare = 0.7F;
/// Voxel of the points for the NDT map and of the candidates for registration.
inline constexpr float kCoarseVoxelMetres = 1.0F;
/// Predicted poses, and failed relocalisations, in a row until the map is reset.
inline constexpr int kRestartAfterFailures = 30;
inline constexpr int kRestartAfterSearches = 10;
/// Maximum of the prediction error, also its initial value.
inline constexpr double kMaxSigmaMetres = 2.0;
/// Minimum of the prediction error; a relocalised pose is registered with it.
inline constexpr double kMinSigmaMetres = 0.1;
/// Share of the usual agreement with the map, or of that of another hypothesis, below which one is out of
/// family.
inline constexpr double kAgreementCollapse = 0.75;
/// Squared Mahalanobis distance, 99.9 % of 6 degrees of freedom.
inline constexpr double kFarInnovation = 22.46;
/// Lever that converts rotation errors to distances.
inline constexpr double kErrorLeverMetres = 30.0;

/// Maximum lag of the last IMU sample behind the end of a live scan; the rate is held constant.
inline constexpr Duration kMaxImuLag = Duration::from_milliseconds(15.0);

/// Voxel of the point map.
inline constexpr double kPointVoxelMetres = 1.0;
inline constexpr std::size_t kCoarsePoints = 800;
/// Beam numbers that differ by this belong to different beams.
inline constexpr float kBeamSpread = 0.5F;

/// Metric of a guess whose points are off by `sigma_m` everywhere.
[[nodiscard]] PlaneMetric plane_metric(double sigma_m);

/// Samples at most `target` elements evenly.
void sample_evenly(const std::vector<Eigen::Vector3f>& points, std::size_t target,
                   std::vector<Eigen::Vector3f>& output);

/// State of the odometry from scan to scan, and its steps: map/local_map.cpp,
/// estimation/motion_prediction.cpp, registration/ndt_icp.cpp, recovery/tracking_gate.cpp,
/// recovery/relocalization.cpp.
struct Odometry::State {
  explicit State(const OdometryConfig& configuration, ClockFunction clock_function)
      : config(configuration),
        clock(clock_function),
        method(info_of(config.registration)),
        arena(configuration.threads),
        single_thread_arena(1),
        imu(configuration.imu_capacity),
        monitor({config.T_base_imu.translation, config.max_imu_gap}),
        planes(plane_map_config(config)),
        ndt_map({config.coarse_voxel_m, config.map_radius_m, config.coarse_map_capacity}),
        budget(config.budget, clock),
        filter(config.max_filtered_points),
        selector(config.max_filtered_points) {
    if (method.needs_points)
      point_map.emplace(PointMapConfig{kPointVoxelMetres, config.map_radius_m, config.map_capacity});
    // Prefaults the buffers.
    const auto prepare = [](std::size_t capacity, auto&... buffers) {
      (buffers.resize(capacity), ...);
      (buffers.clear(), ...);
    };
    prepare(config.max_filtered_points, sweep, first_sweep, deskewed, world_points, coarse_world_points,
            beams);
    prepare(config.registration_points, selection, selected_sweep, selected, point_times);
    prepare(kCoarsePoints, coarse_points, search_points);
  }

  static VoxelMapConfig plane_map_config(const OdometryConfig& config) {
    VoxelMapConfig result{plane_voxel_for(config, 0.0F), config.map_radius_m, config.map_capacity};
    result.min_beam_spread = kBeamSpread;
    return result;
  }

  void stamp(OdometryResult& result, OdometryStage stage) const {
    if (clock != nullptr) result.stage_ns[static_cast<std::size_t>(stage)] = clock();
  }

  /// Best hypothesis so far, by inliers.
  struct Search {
    SE3 T_best;
    std::uint32_t inliers = 0;
  };

  /// Prediction of a scan's motion.
  struct MotionPrior {
    Time previous;  ///< of the last pose
    SweepSpan span;
    bool imu_covers = false;  ///< from the midpoint of the last sweep to the end of this one
    MotionInputs inputs;
    bool is_stationary = false;
    [[nodiscard]] double span_s() const { return (span.end - previous).seconds(); }
  };

  /// A registration with what it rests on.
  struct Hypothesis {
    MotionPrior prior;
    MotionFilter filter;
    SweepMotion motion;
    RegistrationResult registration;
    std::size_t points = 0;
    double agreement = 0.0;
  };
  [[nodiscard]] Hypothesis hypothesis() const;
  void return_to(const Hypothesis& earlier, OdometryResult& result);

  // The steps of the algorithm, in the order of use.
  [[nodiscard]] static OdometryResult result_for(const Scan& scan);
  void filter_points(const Scan& scan, OdometryResult& result);
  [[nodiscard]] bool restart_is_due() const;
  void reset_map();
  void start(const Scan& scan, OdometryResult& result);
  void predict(const Scan& scan, OdometryResult& result);
  void select_points(const SE3& T_guess);
  [[nodiscard]] bool coarse_is_due() const;
  tbb::task_arena& registration_arena();
  void register_sweep(OdometryResult& result);
  void register_predicted(OdometryResult& result);
  void reconsider_imu(OdometryResult& result);
  void reconsider_stationary(OdometryResult& result);
  void end_stationary();
  RegistrationResult register_coarse(OdometryResult& result);
  [[nodiscard]] RegistrationResult kept_coarse(RegistrationResult coarse, const PlaneMetric& metric,
                                               const std::optional<PosePrior>& prior);
  void try_hypothesis(const SE3& T_guess, Search& search, OdometryResult& result);
  [[nodiscard]] SE3 start_hypothesis(std::size_t i) const;
  [[nodiscard]] SE3 relocalization_hypothesis(std::size_t i) const;
  void find_initial_velocity(OdometryResult& result);
  void start_moving(const SE3& T_map_middle);
  void compare_hypotheses(OdometryResult& result);
  void register_anew(OdometryResult& result);
  void relocalize(OdometryResult& result);
  void count_inliers(OdometryResult& result) const;
  [[nodiscard]] SweepProblem sweep_problem();
  [[nodiscard]] bool refine_motion();
  void register_points(bool coarse, PlaneMetric metric, OdometryResult& result);
  void rebuild_first_map();
  [[nodiscard]] bool has_no_time() const;
  [[nodiscard]] TrackingState state_without_registration(int scans_to_come = 0) const;
  [[nodiscard]] DegradationLevel degradation_level_of(const OdometryResult& result) const;
  [[nodiscard]] bool has_pose() const;
  [[nodiscard]] bool is_plausible() const;
  [[nodiscard]] SE3 prediction_error() const;
  [[nodiscard]] static bool is_drivable(const SE3& off, double seconds);
  [[nodiscard]] bool is_drivable_step(const SE3& T_map_end, double seconds) const;
  [[nodiscard]] bool exceeds_motion_limits() const;
  [[nodiscard]] bool has_converged() const { return registration.stop_reason == StopReason::kConverged; }
  [[nodiscard]] bool fits_prediction() const;
  [[nodiscard]] bool bridges_gap() const;
  [[nodiscard]] double agreement() const;
  [[nodiscard]] bool is_in_family() const;
  [[nodiscard]] bool is_doubtful() const;
  void check_registration(OdometryResult& result);
  void accept(OdometryResult& result);
  void fall_back(OdometryResult& result);
  void apply_pending_map_update();
  void update_maps();
  void calibrate_beams();
  void finish(const Scan& scan, OdometryResult& result);
  void count_map(OdometryResult& result) const;

  // Parts of the steps.
  [[nodiscard]] MotionPrior motion_prior_for(const Scan& scan) const;
  [[nodiscard]] Duration recovery_budget(const Scan& scan) const;
  /// `span_s`: time since the last scan.
  [[nodiscard]] bool is_gap(double span_s) const;
  void set_poses(const SweepMotion& moved, const SE3& T_map_end, OdometryResult& result) const;
  void fill_motion(const SweepMotion& moved, const MotionState& state, OdometryResult& result) const;
  void fill_confidence(const MotionFilter& filter, const SweepMotion& moved, const SE3& T_map_pose,
                       double span_s, OdometryResult& result) const;
  void align_with_gravity(const Scan& scan);
  [[nodiscard]] bool detect_stationary();
  void initialize_gravity();
  void predict_motion();
  /// Standard deviation of the predicted displacement of a point at the lever, metres.
  [[nodiscard]] double prediction_deviation() const;
  [[nodiscard]] PlaneMetric metric_of_prediction() const;
  void insert(const std::vector<SweepPoint>& seen, const std::vector<Eigen::Vector3f>& points,
              const SE3& T_odom_moving);
  void insert_planes(const std::vector<SweepPoint>& seen);
  void insert_coarse(const std::vector<Eigen::Vector3f>& points);
  [[nodiscard]] std::optional<PosePrior> pose_prior() const;
  RegistrationResult register_fine(const std::vector<Eigen::Vector3f>& points, const SE3& T_guess,
                                   const PlaneMetric& metric, const std::optional<PosePrior>& prior,
                                   OdometryResult& result);
  [[nodiscard]] RegisteredMotion registered_motion() const;
  void follow(const MotionState& state);
  void update_motion();
  void relocate_motion();
  void skip_motion();
  void weigh_accelerometer(double innovation_squared);
  void count_coarse_scan();

  OdometryConfig config;
  ClockFunction clock;
  const RegistrationMethodInfo& method;
  tbb::task_arena arena;
  tbb::task_arena single_thread_arena;  ///< for small work
  ImuBuffer imu;
  ImuMonitor monitor;
  MotionFilter motion_filter;
  MotionFilter last_filter;  ///< before the prediction of the scan
  StationaryDetector stationary_detector;
  VoxelMap planes;
  std::optional<PointMap> point_map;  ///< only for methods that need it
  VoxelMap ndt_map;
  ComputeBudget budget;
  VoxelDownsampler filter;  ///< scratch, reused
  NormalSpaceSampler selector;
  BeamCalibration beam_calibration;
  SweepMotion motion;

  std::uint64_t scans = 0;
  std::size_t last_fine_iterations = 0;
  /// The last scan has not been inserted yet.
  bool map_update_pending = false;
  /// Denser insertion while initialising.
  bool is_initializing_map = true;
  /// The map keeps the axes of the first pose and is levelled only in the output, so that registration does
  /// not depend on the accelerometer.
  SE3 T_odom_map;
  SE3 T_map_base;  ///< at the end of the last sweep; the filter's is at its midpoint
  SE3 T_accepted;  ///< the last pose that is not a prediction
  SE3 T_published;
  double published_speed = 0.0;   ///< of its twist, m/s
  std::optional<Time> jumped_at;  ///< last pose to which no vehicle can have driven
  SE3 T_stationary;               ///< midpoint of the sweeps while stationary
  SE3 T_last_keyframe;            ///< midpoint of the sweep inserted last
  Time time;
  Time registered_time;  ///< of the last pose that is not a prediction
  SE3 T_predicted;
  MotionPrior motion_prior;  ///< of the scan that is registered
  bool coarse_was_due = false;
  bool motion_compensated = false;
  bool is_manoeuvring = false;  ///< the registration contradicts the predicted motion
  /// The pose is relocalised, or follows a predicted one: the step is no motion of this scan.
  bool relocalized = false;
  /// Whether the last pose was relocalised or out of family, how many were so in a row (predicted ones
  /// included), and the failed relocalisations among them.
  bool doubtful = false;
  int doubts = 0;
  int relocalization_attempts = 0;
  SE3 T_map_last_middle;  ///< midpoint of the last sweep, and its time
  Time last_middle;
  bool gravity_known = false;
  bool motion_is_known = false;  ///< at the start of this map
  Time accelerometer_banned_until;
  /// Mean normalised innovation squared of recent scans with the accelerometer.
  double accelerometer_innovations = 0.0;
  double sigma_m = kMaxSigmaMetres;  ///< of the prediction, at the lever
  double prediction_error_m = 0.0;
  double plane_voxel_m = 0.0;
  double period_s = 0.1;  ///< between poses, slowly averaged
  double mean_agreement = 0.0;
  /// Share of the scan's points that a known voxel holds, and its mean.
  double known_share = 0.0;
  double mean_known_share = 0.0;
  int coarse_scans_left = kMinScansWithNdt;  ///< remaining scans with NDT
  int failures = 0;
  bool recovers = false;              ///< the last registration failed, and not for lack of time
  std::size_t scan_points = 0;        ///< visited points of the scan
  std::size_t registered_points = 0;  ///< points of the last registration
  /// Hypothesis at which relocalisation continues in the next scan.
  std::size_t next_hypothesis = 0;
  RegistrationResult registration;

  // The first scan is kept until the second gives the initial velocity.
  std::vector<SweepPoint> first_sweep;
  SweepSpan first_span;

  std::vector<SweepPoint> sweep;
  std::vector<SweepPoint> selected_sweep;
  std::vector<std::uint32_t> selection;
  std::vector<Eigen::Vector3f> deskewed;
  std::vector<Eigen::Vector3f> selected;
  std::vector<float> point_times;  ///< of the selected points from the sweep's midpoint, s
  std::vector<Eigen::Vector3f> coarse_points;
  std::vector<Eigen::Vector3f> search_points;
  std::vector<Vector3> world_points;
  std::vector<Vector3> coarse_world_points;
  std::vector<float> beams;
};

}  // namespace nilio::core
