#pragma once

#include "nilio/core/compute_budget.hpp"
#include "nilio/core/se3.hpp"
#include "nilio/core/time.hpp"

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string_view>

namespace nilio::core {

/// How a scan is registered against the map: NI-LIO's NDT and ICP, and the methods that its paper compares
/// them with.
enum class RegistrationMethod : std::uint8_t { kNdtIcp, kNdt, kIcpPlane, kIcpLine, kIcpPoint };

/// All methods, the default first.
inline constexpr std::array kRegistrationMethods = {
    RegistrationMethod::kNdtIcp, RegistrationMethod::kNdt, RegistrationMethod::kIcpPlane,
    RegistrationMethod::kIcpLine, RegistrationMethod::kIcpPoint};

/// Name in configuration and tables: "ndt_icp", ...
const char* name_of(RegistrationMethod method);
/// The method of that name, or nothing.
std::optional<RegistrationMethod> registration_method_of(std::string_view name);

/// When the NDT coarse stage runs.
enum class CoarsePolicy : std::uint8_t {
  kAuto,    ///< while initialising, after a gap, a rejected registration or a large prediction error
  kAlways,  ///< once in every scan
};

/// Parameters of the odometry. One default serves all sensors.
struct OdometryConfig {
  SE3 T_base_lidar;
  SE3 T_base_imu;
  /// Threads of the arena that registration runs in. Results do not depend on it.
  int threads = 1;

  /// Raises every beam by this angle: the bias of a scanner's factory calibration (0.205 deg for KITTI's
  /// HDL-64E, as IMLS-SLAM and others found). 0 for every other sensor.
  float elevation_correction_rad = 0.0F;
  /// Finds the errors of each beam while driving.
  bool calibrate_beams = true;
  float min_range_m = 2.0F;
  float max_range_m = 100.0F;
  /// Voxel of the points that feed the map.
  float filter_voxel_m = 0.5F;
  std::size_t max_filtered_points = 40000;
  /// Points of a scan that are visited, spread evenly over it; methods that register against points visit
  /// all.
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
  int max_passes = 6;
  int max_fine_iterations = 8;
  int max_coarse_iterations = 40;

  /// Does not limit the first five scans: a correct start is worth more than five early poses.
  BudgetConfig budget;

  std::size_t imu_capacity = 8192;
  /// A longer gap between IMU samples is not bridged: the scan is predicted at constant twist. Over this one
  /// a body that sways by 1 deg/s for 0.3 s turns as far from the line between two samples as by gyro noise.
  Duration max_imu_gap = Duration::from_milliseconds(60.0);
};

/// Edge of the plane voxels for a sensor with beams so far apart, metres.
double plane_voxel_for(const OdometryConfig& config, float beam_spacing_rad);

}  // namespace nilio::core
