#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/scan.hpp"
#include "nilio/core/se3.hpp"
#include "nilio/core/time.hpp"

#include "tools/common/trajectory.hpp"

#include <array>
#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace nilio::tools::convert {

/// One return of a KITTI scan: LiDAR frame (x forward, y left, z up), metres; reflectance 0..1.
struct KittiPoint {
  float x = 0.0F;
  float y = 0.0F;
  float z = 0.0F;
  float reflectance = 0.0F;
};

struct KittiRawScan {
  /// Number in the file name = row of the stamp files.
  std::size_t frame = 0;
  std::filesystem::path path;
  core::Time start;
  core::Time end;
};

/// The used fields of a line of oxts/data. IMU axes: x forward, y left, z up.
struct OxtsRecord {
  core::Time stamp;
  double latitude_deg = 0.0;
  double longitude_deg = 0.0;
  double altitude_m = 0.0;
  double position_deviation_m = 0.0;  ///< north and east, as the receiver states it
  /// Roll, pitch, yaw (0 = east, counter-clockwise), rad.
  core::Vector3 roll_pitch_yaw = core::Vector3::Zero();
  /// Specific force, m/s^2, and angular rate, rad/s.
  std::array<double, 3> linear_acceleration{};
  std::array<double, 3> angular_velocity{};
};

/// A "raw data" drive of KITTI (Geiger et al., IJRR 2013), as its _sync archive is laid out.
struct KittiRawDrive {
  /// In order of frames; scans with blank stamps or an implausible duration are left out and counted.
  std::vector<KittiRawScan> scans;
  std::size_t scans_without_stamp = 0;
  /// In order of time, without duplicates; empty for a drive without oxts/.
  std::vector<OxtsRecord> oxts;
  /// From calib_imu_to_velo.txt of the date's folder.
  core::SE3 T_lidar_imu;
};

/// Reads a drive without its points. The calibration is read from the parent of `drive`; the OXTS records
/// from `oxts_drive`/oxts, normally the same drive (its _extract archive has them at 100 Hz). A drive without
/// oxts/ has no records and an identity T_lidar_imu. Errors name file and line.
core::Result<KittiRawDrive> read_kitti_raw(const std::filesystem::path& drive,
                                           const std::filesystem::path& oxts_drive);

/// The points of one .bin file in file order, without trailing (0, 0, 0) points. Fails on a size that is no
/// multiple of a point and on values that are not finite.
core::Result<std::vector<KittiPoint>> read_kitti_scan(const std::filesystem::path& path);

/// "YYYY-MM-DD hh:mm:ss[.fraction]", read as UTC: KITTI writes local time without a zone.
std::optional<core::Time> parse_kitti_stamp(std::string_view text);

/// Stamps of a file by row; unset for a blank row (a scan that KITTI lost).
core::Result<std::vector<std::optional<core::Time>>> read_kitti_stamps(const std::filesystem::path& path);

/// Trajectory of the LiDAR from the OXTS positions, starting at the identity: Mercator projection scaled at
/// the first latitude, as the KITTI raw development kit does.
Trajectory oxts_trajectory(const std::vector<OxtsRecord>& records, const core::SE3& T_lidar_imu);

}  // namespace nilio::tools::convert
