#pragma once

#include "nilio/core/scan.hpp"
#include "nilio/core/se3.hpp"

#include <array>
#include <cstddef>

namespace nilio::core {

/// Distance of a point from a plane of the map.
struct BeamResidual {
  float beam = 0.0F;        ///< number of the beam; others than 0 to kMaxCalibratedBeams - 1 are ignored
  Vector3 point;            ///< corrected, in the frame of the LiDAR, metres
  Vector3 normal;           ///< of the plane, in the frame of the LiDAR
  double distance_m = 0.0;  ///< of the point from the plane, along the normal
  double weight = 0.0;      ///< 0 to 1
};

/// Errors of each beam of a LiDAR in range, elevation and azimuth, beside its calibration (Glennie and Lichti
/// 2010), from the distances of its points to the planes of the map. Those planes hold the errors of all
/// beams, so that only the differences between beams are observable: the corrections have no mean. Not
/// thread-safe.
class BeamCalibration {
 public:
  /// Point of a beam, in the frame of the LiDAR, with the correction. Other beams are left as they are.
  [[nodiscard]] Eigen::Vector3f correct(const Eigen::Vector3f& point, float beam) const;
  /// Correction of a beam, less than kMaxCalibratedBeams; nothing before a residual of it.
  [[nodiscard]] BeamCorrection correction_of(std::size_t beam) const;

  /// Adds a residual of the scan.
  void add(const BeamResidual& residual);
  /// Corrections after the residuals of a scan, whose points deviate from planes by `variance`, m^2.
  void update(double variance);

 private:
  /// Normal equations A x = b of range (m), elevation and azimuth (rad).
  struct Beam {
    Matrix3 A = Matrix3::Zero();
    Vector3 b = Vector3::Zero();
    Matrix3 scan_A = Matrix3::Zero();
    Vector3 scan_b = Vector3::Zero();
    double scan_weight = 0.0;
    Vector3 correction = Vector3::Zero();
    [[nodiscard]] bool is_seen() const { return !A.isZero(); }
  };

  void centre();

  std::array<Beam, kMaxCalibratedBeams> beams_;
};

}  // namespace nilio::core
