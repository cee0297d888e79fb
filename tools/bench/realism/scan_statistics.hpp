#pragma once

#include "nilio/core/scan.hpp"

#include <array>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

namespace nilio::tools::bench {

/// Differences between real and simulated scans of a 64-beam LiDAR, without truth. Voxels of 0.5 m with at
/// least 8 points at 3 to 60 m; thickness: square root of the smallest eigenvalue of their scatter. Scans are
/// taken as recorded, not deskewed. One thread.
class ScanStatistics {
 public:
  /// `firings_per_ring`: azimuth steps of one revolution, returned or not; `sensor_height_m`: above the
  /// ground.
  ScanStatistics(double firings_per_ring, double sensor_height_m);
  void add(const core::Scan& scan);

  /// One figure: its values side by side (three quantiles, say), each with its bounds.
  struct Row {
    std::string name;
    std::vector<double> values;
    int digits = 1;
  };
  [[nodiscard]] std::vector<Row> rows() const;
  [[nodiscard]] std::size_t scans() const { return scans_; }

 private:
  struct RingPoint;
  void add_voxels(const core::Scan& scan);
  void add_ring(const std::vector<RingPoint>& ring);
  void add_isolated(const core::Scan& scan);

  double firings_per_ring_;
  double sensor_height_m_;
  std::size_t scans_ = 0;
  double points_ = 0.0;
  double fired_ = 0.0;
  double returned_ = 0.0;
  double fired_low_ = 0.0;
  double returned_low_ = 0.0;
  std::array<double, 6> range_counts_{};
  std::vector<double> areal_;
  std::vector<double> vertical_;
  std::vector<double> ground_;
  std::vector<double> residuals_;
  double voxels_ = 0.0;
  double areal_voxels_ = 0.0;
  /// Residuals along the ray by ring, of even and odd scans.
  std::array<std::map<int, std::vector<double>>, 2> ring_residuals_;
  /// Second differences by range: 3-20, 20-30, 30-50 m.
  std::array<std::vector<double>, 3> differences_;
  /// Lost firings and firings: ground 3-15, 15-25 m; other 3-15, 15-30 m.
  std::array<double, 4> holes_{};
  std::array<double, 4> hole_firings_{};
  double edges_ = 0.0;
  double mixed_ = 0.0;
  double mixed_near_ = 0.0;
  double isolated_ = 0.0;
  std::vector<float> intensities_;
};

}  // namespace nilio::tools::bench
