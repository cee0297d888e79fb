#pragma once

#include "nilio/core/compute_budget.hpp"
#include "nilio/core/imu_health.hpp"
#include "nilio/core/registration_method.hpp"
#include "nilio/core/scan.hpp"
#include "nilio/core/se3.hpp"
#include "nilio/core/time.hpp"
#include "nilio/core/tracking.hpp"

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>

namespace nilio::core {

/// When the NDT coarse stage runs.
enum class CoarsePolicy : std::uint8_t {
  kAuto,    ///< while initialising, after a gap or a large prediction error, and when ICP alone finds too few
            ///< inliers
  kAlways,  ///< before every ICP, as in the paper
};

/// Everything that can be set. One default serves all sensors.
struct OdometryConfig {
  SE3 T_base_lidar;
  SE3 T_base_imu;
  /// Threads of the arena that registration runs in. Does not change any result.
  int threads = 1;

  /// Raises every beam by this angle: the bias of a scanner's factory calibration (0.205 deg for KITTI's
  /// HDL-64E, as IMLS-SLAM and others found). 0 for every other sensor.
  float elevation_correction_rad = 0.0F;
  float min_range_m = 2.0F;
  float max_range_m = 100.0F;
  /// Voxel of the points that feed the map.
  float filter_voxel_m = 0.5F;
  std::size_t max_filtered_points = 40000;
  /// Points of a scan that are looked at, spread evenly over it; all by methods that register against points.
  std::size_t scan_points = 35000;
  /// Points that registration uses.
  std::size_t registration_points = 2000;

  /// Voxel of the planes; 0 = from the sensor's beam spacing.
  double plane_voxel_m = 0.0;
  double coarse_voxel_m = 2.0;
  double map_radius_m = 100.0;
  std::size_t map_capacity = 65536;
  std::size_t coarse_map_capacity = 20000;

  RegistrationMethod registration = RegistrationMethod::kNdtIcp;
  CoarsePolicy coarse = CoarsePolicy::kAuto;
  int max_passes = 3;
  int max_fine_iterations = 8;
  int max_coarse_iterations = 40;

  /// The first scans are not limited: a right start is worth more than the time of five poses.
  BudgetConfig budget;

  std::size_t imu_capacity = 8192;
  /// A longer gap between IMU samples is not bridged: the scan falls back to constant velocity.
  Duration max_imu_gap = Duration::from_milliseconds(150.0);
};

/// Edge of the plane voxels for a sensor with beams so far apart, metres.
double plane_voxel_for(const OdometryConfig& config, float beam_spacing_rad);

/// Moments inside register_scan, by the injected clock.
enum class OdometryStage : std::uint8_t { kStarted, kFiltered, kCoarse, kFine, kMapped, kCount };

struct OdometryResult {
  std::uint64_t sequence = 0;
  Time scan_start;
  Time scan_end;
  /// Pose of base_link at scan_end.
  SE3 T_odom_base;
  /// Covariance of the registration against the map: position then rotation, in odom axes; m^2, rad^2.
  Matrix6 pose_covariance = Matrix6::Zero();
  /// Linear then angular velocity of base_link in its own axes, m/s and rad/s.
  Vector6 twist = Vector6::Zero();
  /// Mean rate with which the scan is deskewed, rad/s in base_link; 0 when it is not.
  Vector3 deskew_rate = Vector3::Zero();
  Matrix6 twist_covariance = Matrix6::Zero();
  /// What is subtracted from the gyro's rates, rad/s in base_link, and from the IMU's stamps.
  Vector3 gyro_bias = Vector3::Zero();
  Duration imu_time_shift;
  TrackingState state = TrackingState::kInitialising;
  StopReason stop_reason = StopReason::kConverged;
  bool imu_used = false;
  /// No registration was accepted: the pose is the prediction.
  bool predicted = false;
  std::uint8_t degenerate_axes = 0;
  /// How far the budget cut the registration, whether or not it converged.
  BudgetRung rung = BudgetRung::kFull;
  int passes = 0;
  int coarse_iterations = 0;
  int fine_iterations = 0;
  std::uint32_t points = 0;
  std::uint32_t points_filtered = 0;
  std::uint32_t points_used = 0;
  std::uint32_t correspondences = 0;
  /// Share of the points used that lie within the inlier distance of a map plane.
  double inlier_ratio = 0.0;
  std::uint32_t map_voxels = 0;
  std::uint64_t map_refused = 0;
  std::array<std::int64_t, static_cast<std::size_t>(OdometryStage::kCount)> stage_ns{};
};

/// NI-LIO's odometry: filter, deskew with the IMU, NDT coarse and point-to-plane ICP fine until convergence,
/// map update. Not thread-safe: one thread owns it. No I/O and no clock but the injected one, which only
/// fills stage_ns.
class Odometry {
 public:
  using ClockFunction = std::int64_t (*)();

  explicit Odometry(const OdometryConfig& config, ClockFunction clock = nullptr);
  Odometry(Odometry&&) noexcept;
  Odometry& operator=(Odometry&&) noexcept;
  Odometry(const Odometry&) = delete;
  Odometry& operator=(const Odometry&) = delete;
  ~Odometry();

  /// Wakes the arena's threads and calls `on_thread`, which must not throw, once in each, all at the same
  /// time; waits a second for those that do not come. Says how many did. To be called before the first scan
  /// by the thread that will register them: the others are started by it and inherit its scheduling.
  int warm_up(const std::function<void()>& on_thread);

  /// Samples in order of time, before the scans they cover. False when the sample was refused (time goes
  /// back, not finite).
  bool add_imu(const ImuSample& sample);
  [[nodiscard]] std::optional<Time> latest_imu() const;
  /// What is known of the IMU after the last scan: OdometryResult::imu_used follows from it.
  [[nodiscard]] const ImuHealth& imu_health() const;

  /// Always gives a pose. Scans in order of time. The budget runs from Scan::received_ns, if that is known.
  OdometryResult register_scan(const Scan& scan);
  /// As an earlier run did that made these decisions, whatever the budget.
  OdometryResult register_scan(const Scan& scan, const BudgetDecisions& decisions);
  /// The pose that register_scan() gave has been handed over: what that took belongs to the scan.
  void note_handed_over(const OdometryResult& result);
  [[nodiscard]] const WorkBudget& budget() const;
  /// Where base_link is expected to be at `end`, as a scan that ends then would be predicted; in case its
  /// registration comes too late.
  [[nodiscard]] OdometryResult predict_pose(const Scan& scan) const;
  /// Feeds the map with the scan that was registered last, whose `result` it completes (kMapped, map_voxels,
  /// map_refused). Apart from register_scan(), so that a pose need not wait for the map; what is not done by
  /// then is done by the next register_scan().
  void update_map(OdometryResult& result);

  /// The scan that was registered last, deskewed and filtered, in base_link at its end: for submaps and
  /// pictures. To be asked after update_map().
  [[nodiscard]] const std::vector<Eigen::Vector3f>& deskewed_points() const;

 private:
  struct State;
  OdometryResult register_within_budget(const Scan& scan);
  std::unique_ptr<State> state_;
};

}  // namespace nilio::core
