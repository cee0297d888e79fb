#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace nilio::tools::bench {

using Cloud = std::vector<Eigen::Vector3d>;

/// Windows of a sharpness measurement. The defaults are those of the published figures; change none to
/// compare with them.
struct SharpnessOptions {
  std::size_t window = 20;  ///< scans
  std::size_t hop = 10;     ///< scans from one window to the next
  std::size_t stride = 2;   ///< every second scan of a window is used
};

/// Sharpness of the local maps that one trajectory gives.
struct Sharpness {
  /// Spread of the offsets of single scans from the common plane of an anchor: root mean square (at most 0.1
  /// m an anchor) and median.
  double shift_rms_mm = 0.0;
  double shift_median_mm = 0.0;
  /// Thickness of the points at an anchor: median and lower quartile.
  double thickness_median_mm = 0.0;
  double thickness_quartile_mm = 0.0;
  /// Mean differential entropy, nat.
  double entropy = 0.0;
  /// Share of the anchors with enough neighbours: a broken trajectory loses them. Figures of two trajectories
  /// are comparable only where this agrees.
  double coverage = 0.0;
  std::size_t anchors = 0;
  std::size_t windows = 0;
};

/// Scan as it enters a map: points from 5 to 50 m, elevation raised by `elevation_correction_deg`, the first
/// point of every 0.1 m cell.
Cloud prepare_scan(Cloud points, double elevation_correction_deg);

/// The first point of every cell.
Cloud first_per_cell(const Cloud& points, double cell_m);

/// Motion of a scan period in the sensor's axes: translation, then rotation vector.
using ScanMotion = Eigen::Matrix<double, 6, 1>;
/// Mean motion over three scans to either side of scan `i`.
ScanMotion mean_motion(std::span<const Eigen::Isometry3d> poses, std::size_t i);
/// Compensates the motion of a sweep of KITTI's raw drives, which begins behind the vehicle: the time of a
/// point follows from its azimuth, the reference is the moment at which the sensor looks ahead.
Cloud compensate(Cloud points, const ScanMotion& motion);

/// Measures trajectories on the same clouds and the same anchors. The anchors are points of the middle scan
/// of a window, one in every cell of 1 m; only those that every trajectory covers count, and only points of
/// other scans within 0.5 m are compared, so that no figure depends on a single scan or can gain by losing
/// anchors. `poses[k][i]`: pose of the sensor at scan i by trajectory k. Empty if there are fewer scans than
/// a window.
std::vector<Sharpness> measure_sharpness(std::span<const Cloud> scans,
                                         std::span<const std::vector<Eigen::Isometry3d>> poses,
                                         const SharpnessOptions& options);

}  // namespace nilio::tools::bench
