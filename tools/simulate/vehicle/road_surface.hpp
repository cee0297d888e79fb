#pragma once

#include <cstdint>
#include <vector>

namespace nilio::tools::simulate {

/// One unevenness across the road: a raised cosine.
struct RoadEvent {
  double at_m = 0.0;
  double length_m = 1.0;
  /// Negative: a pothole, a joint.
  double height_m = 0.05;
};

/// Surface under the wheels. Roughness as ISO 8608: displacement power spectral density at 0.1 cycles/m, m^3;
/// geometric means of the classes: A 16e-6, B 64e-6, C 256e-6, D 1024e-6, E 4096e-6.
struct RoadSurface {
  double roughness_m3 = 64e-6;
  std::vector<RoadEvent> events;
  /// Corrugation of unpaved roads; 0 = none.
  double washboard_m = 0.0;
  double washboard_length_m = 0.7;
};

/// Heights under the left and right wheels along a drive, averaged over the tyre's contact. Immutable.
class RoadProfile {
 public:
  /// For distances from `from_m` to `to_m`.
  RoadProfile(const RoadSurface& surface, double from_m, double to_m, std::uint64_t seed);
  [[nodiscard]] double height(double at_m, bool left) const;

 private:
  double from_m_;
  std::vector<double> left_;
  std::vector<double> right_;
};

}  // namespace nilio::tools::simulate
