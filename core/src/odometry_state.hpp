#pragma once

#include "nilio/core/felt_motion_filter.hpp"
#include "nilio/core/felt_velocity.hpp"
#include "nilio/core/imu_buffer.hpp"
#include "nilio/core/imu_monitor.hpp"
#include "nilio/core/odometry.hpp"
#include "nilio/core/point_selection.hpp"
#include "nilio/core/pose_covariance.hpp"
#include "nilio/core/standing_start.hpp"
#include "nilio/core/sweep.hpp"
#include "nilio/core/sweep_motion.hpp"
#include "nilio/core/twist_filter.hpp"
#include "nilio/core/voxel_map.hpp"

#include <algorithm>
#include <cstdint>
#include <optional>
#include <vector>

#include <tbb/task_arena.h>

namespace nilio::core {

/// Scans until map and velocity are established. The map is fed more densely meanwhile: one thinned scan
/// leaves its voxels short of the points that a plane needs.
inline constexpr std::uint64_t kInitialScans = 5;
/// NDT goes first in the beginning, until so many scans have shown every axis; after one that has not, until
/// so many in a row do. While nothing is known of the speed, a plane or two of somebody else's vehicle would
/// tell it.
inline constexpr int kLeastScansWithNdt = 4;
inline constexpr int kScansToBeSure = 20;
inline constexpr float kFirstVoxelShare = 0.5F;
inline constexpr float kInitialVoxelShare = 0.7F;
/// Voxel of the points that the coarse map is fed with and that registration chooses from.
inline constexpr float kCoarseVoxelMetres = 1.0F;
/// Scans without a pose after which the old map is given up: it has moved out of sight, or the search would
/// have found it. So many searches in a row that did not lead back to tracking saw another place.
inline constexpr int kRestartAfterFailures = 30;
inline constexpr int kRestartAfterSearches = 10;
/// Largest prediction error that the gate follows; also where it starts.
inline constexpr double kMaxSigmaMetres = 2.0;
/// Where the gate is, in such errors.
inline constexpr double kGateSigmas = 3.0;
/// Least one. A place that was searched for has to agree as closely.
inline constexpr double kMinSigmaMetres = 0.1;
/// An acceleration that is sampled more seldom says little of the velocity between its samples.
inline constexpr Duration kMaxFeltGap = Duration::from_milliseconds(50.0);
/// What turns rotation into distance where errors are put together.
inline constexpr double kErrorLeverMetres = 30.0;
/// Of the support as an IMU has it that stands.
inline constexpr double kStandingSupportVariance = 0.02 * 0.02;

/// The last sample may be so much older than the end of the scan, live, where the next one was not waited
/// for: a vehicle turns on as it did.
inline constexpr Duration kMaxImuLag = Duration::from_milliseconds(15.0);

/// Neighbours of a point are looked for this far.
inline constexpr double kPointVoxelMetres = 1.0;
inline constexpr std::size_t kCoarsePoints = 800;
/// Points whose beams differ by this come from different ones.
inline constexpr float kBeamSpread = 0.5F;

/// For a scan whose prediction errs by so much.
[[nodiscard]] PlaneMetric plane_metric(double sigma_m);

/// Every k-th element, at most `target` of them.
void thin_evenly(const std::vector<Eigen::Vector3f>& points, std::size_t target,
                 std::vector<Eigen::Vector3f>& output);

/// What the odometry keeps from scan to scan, and its steps: filtering and map in odometry_map.cpp,
/// prediction in odometry_prediction.cpp, registration in odometry_registration.cpp, what it teaches in
/// odometry_learning.cpp, the search for a start or a lost vehicle in odometry_search.cpp.
struct Odometry::State {
  explicit State(const OdometryConfig& configuration, ClockFunction clock_function)
      : config(configuration),
        clock(clock_function),
        method(info_of(config.registration)),
        arena(configuration.threads),
        lone_arena(1),
        imu(configuration.imu_capacity),
        monitor({config.T_base_imu.translation, config.max_imu_gap}),
        felt_velocity(config.T_base_imu.translation, std::min(config.max_imu_gap, kMaxFeltGap)),
        planes(plane_map_config(config)),
        coarse_map({config.coarse_voxel_m, config.map_radius_m, config.coarse_map_capacity}),
        budget(config.budget, clock),
        filter(config.max_filtered_points),
        selector(config.max_filtered_points) {
    if (method.needs_points)
      point_map.emplace(PointMapConfig{kPointVoxelMetres, config.map_radius_m, config.map_capacity});
    // Touched here, so that the first scans do not wait for their memory.
    const auto prepare = [](std::size_t capacity, auto&... buffers) {
      (buffers.resize(capacity), ...);
      (buffers.clear(), ...);
    };
    prepare(config.max_filtered_points, sweep, first_sweep, deskewed, world_points, coarse_world_points,
            beams);
    prepare(config.registration_points, selection, selected_sweep, selected);
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

  /// The pose that most points agreed with so far.
  struct Search {
    SE3 T_best;
    std::uint32_t inliers = 0;
  };

  /// What the prediction of a scan's end goes by.
  struct Outlook {
    SweepMotion::Span span;
    bool imu_covers = false;  ///< the span
    bool imu_used = false;    ///< covers it and is trusted
    bool stands = false;      ///< has been standing since the beginning
    /// Mean over the time from the middle of the sweep before to that of this one.
    std::optional<Vector3> acceleration;
    [[nodiscard]] double span_s() const { return (span.end - span.previous).seconds(); }
  };

  // The steps of the algorithm, in the order of use.
  [[nodiscard]] static OdometryResult result_for(const Scan& scan);
  void filter_points(const Scan& scan, OdometryResult& result);
  [[nodiscard]] bool restart_is_due() const;
  void forget_map();
  void start(const Scan& scan, OdometryResult& result);
  void predict(const Scan& scan, OdometryResult& result);
  void select_points(const SE3& T_guess);
  [[nodiscard]] bool coarse_is_due() const;
  [[nodiscard]] bool after_gap() const;
  tbb::task_arena& registration_arena();
  void register_sweep(OdometryResult& result);
  void reconsider_imu(OdometryResult& result);
  RegistrationResult register_coarse(OdometryResult& result);
  [[nodiscard]] RegistrationResult kept_coarse(RegistrationResult coarse, const PlaneMetric& metric);
  void try_hypothesis(const SE3& T_guess, Search& search, OdometryResult& result);
  [[nodiscard]] SE3 start_hypothesis(std::size_t i) const;
  [[nodiscard]] SE3 lost_hypothesis(std::size_t i) const;
  void register_from_standstill(OdometryResult& result);
  void compare_hypotheses(OdometryResult& result);
  void register_anew(OdometryResult& result);
  void search_lost_vehicle(OdometryResult& result);
  void count_inliers(OdometryResult& result) const;
  SE3 refine_motion(SE3& T_map_end);
  void register_points(bool coarse, const PlaneMetric& metric, OdometryResult& result);
  void rebuild_first_map();
  [[nodiscard]] bool has_no_time() const;
  [[nodiscard]] TrackingState state_without_registration(int scans_to_come = 0) const;
  [[nodiscard]] BudgetRung rung_of(const OdometryResult& result) const;
  [[nodiscard]] bool has_pose() const;
  [[nodiscard]] bool is_plausible() const;
  [[nodiscard]] SE3 prediction_error() const;
  [[nodiscard]] static bool is_drivable(const SE3& off, double seconds);
  [[nodiscard]] bool is_drivable_step(const SE3& T_map_end, double seconds) const;
  [[nodiscard]] bool is_out_of_reach() const;
  [[nodiscard]] bool has_converged() const { return registration.stop_reason == StopReason::kConverged; }
  [[nodiscard]] double agreement() const;
  [[nodiscard]] bool is_in_family() const;
  [[nodiscard]] bool is_doubtful() const;
  void judge(OdometryResult& result);
  void accept(OdometryResult& result);
  void fall_back(OdometryResult& result);
  void catch_up_with_map();
  void update_maps();
  void finish(const Scan& scan, OdometryResult& result);
  void count_map(OdometryResult& result) const;

  // Parts of the steps.
  [[nodiscard]] Outlook outlook(const Scan& scan) const;
  void fill_motion(const SweepMotion& moved, OdometryResult& result) const;
  void align_with_gravity(const Scan& scan);
  void set_rotation(const SweepMotion::Span& target_span, bool with_imu, const Vector6& expected,
                    SweepMotion& target) const;
  [[nodiscard]] std::optional<Vector3> felt_acceleration(const Outlook& next) const;
  [[nodiscard]] Vector6 expected_twist(const Outlook& next) const;
  /// The accelerometer has seen the whole of the motion, and is not known to be broken.
  [[nodiscard]] bool is_felt() const { return ahead.imu_covers && monitor.force_usable(ahead.span.previous); }
  [[nodiscard]] bool stands_since_start();
  /// The second scan still has to tell whether standing is what a smooth ride is taken for.
  [[nodiscard]] bool is_held_still() const { return ahead.stands && scans > 1; }
  void advance_felt_motion();
  [[nodiscard]] TwistStep measured_step() const;
  [[nodiscard]] SE3 expected_pose(const Outlook& next, SweepMotion& target) const;
  void insert(const std::vector<SweepPoint>& seen, const std::vector<Eigen::Vector3f>& points,
              const SE3& T_odom_moving);
  void insert_planes(const std::vector<SweepPoint>& seen);
  void insert_coarse(const std::vector<Eigen::Vector3f>& points);
  [[nodiscard]] std::optional<PosePrior> pose_prior() const;
  RegistrationResult register_fine(const std::vector<Eigen::Vector3f>& points, const SE3& T_guess,
                                   const PlaneMetric& metric, const std::optional<PosePrior>& prior,
                                   OdometryResult& result);
  [[nodiscard]] RegisteredMotion registered_motion() const;
  void learn_motion();
  void skip_motion();
  void forget_felt_motion();
  void learn_gyro_bias();
  [[nodiscard]] TurnRate turn_rate(bool by_gyro) const;
  [[nodiscard]] Vector3 seen_share() const;
  void learn_felt_velocity();
  void learn_velocity();
  void correct_felt_motion();
  void learn_prediction_error();
  void forget_prediction_error();
  void count_scan_with_ndt();

  OdometryConfig config;
  ClockFunction clock;
  const RegistrationMethodInfo& method;
  tbb::task_arena arena;
  tbb::task_arena lone_arena;  ///< where others would take longer to wake up than to help
  ImuBuffer imu;
  ImuMonitor monitor;
  FeltVelocity felt_velocity;
  FeltMotionFilter felt_motion;
  StandingStart standing_start;
  VoxelMap planes;
  std::optional<PointMap> point_map;  ///< only for methods that need it
  VoxelMap coarse_map;
  WorkBudget budget;
  VoxelFilter filter;  ///< of one use after the other
  PointSelector selector;
  SweepMotion motion;

  std::uint64_t scans = 0;
  std::size_t last_fine_iterations = 0;
  /// The scan registered last has not been fed to the map yet.
  bool map_is_behind = false;
  /// The first scans feed the map more densely.
  bool feeds_densely = true;
  /// The map has the axes of the first pose, levelled only on the way out: what is registered does not depend
  /// on an accelerometer that may be wrong.
  SE3 T_odom_map;
  SE3 T_map_base;
  SE3 T_accepted;  ///< the last pose that is not a prediction
  SE3 T_published;
  double published_speed = 0.0;  ///< of its twist, m/s
  SE3 T_fed;       ///< the middle of the sweep that the map was fed last
  Time time;
  Time registered_time;  ///< of the last pose that is not a prediction
  SE3 T_predicted;
  Outlook ahead;  ///< of the scan that is registered
  bool coarse_was_due = false;
  bool motion_compensated = false;
  /// The previous pose was a prediction, or this one was searched for: what lies between them is no motion of
  /// this scan.
  bool relocated = false;
  /// The last pose was searched for or agrees with the map worse than usual; how many did so in a row,
  /// predicted ones included, and after how many of them the vehicle was looked for everywhere.
  bool doubtful = false;
  int doubts = 0;
  int searches = 0;
  SE3 last_half_sweep;  ///< of the scan before: from the middle of its sweep to its end
  double last_sweep_s = 0.0;
  TwistFilter twist;
  Vector6 measured_twist = Vector6::Zero();  ///< by the last registration
  Vector3 deskew_rate = Vector3::Zero();     ///< mean angular velocity of the last deskewing
  Vector3 gyro_bias = Vector3::Zero();
  std::uint64_t bias_updates = 0;
  double sigma_m = kMaxSigmaMetres;
  int sigma_scans = 0;  ///< that it has been learnt from since nothing was known of it
  double prediction_error_m = 0.0;
  Vector6 prediction_square = Vector6::Zero();  ///< of corrections of predictions, in body axes
  double plane_voxel_m = 0.0;
  UnobservedDrift drift;
  double period_s = 0.1;  ///< between poses, slowly averaged
  double mean_agreement = 0.0;
  int scans_with_ndt = kLeastScansWithNdt;  ///< that are still to come
  int failures = 0;
  std::size_t scan_points = 0;        ///< of the scan that are looked at
  std::size_t registered_points = 0;  ///< that `registration` was given
  /// Where the search for a lost vehicle goes on, when a scan's time was over before its end.
  std::size_t next_hypothesis = 0;
  RegistrationResult registration;

  // The first scan is kept until the second has told how fast the vehicle was.
  std::vector<SweepPoint> first_sweep;
  SweepMotion::Span first_span;

  std::vector<SweepPoint> sweep;
  std::vector<SweepPoint> selected_sweep;
  std::vector<std::uint32_t> selection;
  std::vector<Eigen::Vector3f> deskewed;
  std::vector<Eigen::Vector3f> selected;
  std::vector<Eigen::Vector3f> coarse_points;
  std::vector<Eigen::Vector3f> search_points;
  std::vector<Vector3> world_points;
  std::vector<Vector3> coarse_world_points;
  std::vector<float> beams;
};

}  // namespace nilio::core
