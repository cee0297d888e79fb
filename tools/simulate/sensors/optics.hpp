#pragma once

#include "nilio/drivers/velodyne/model.hpp"

#include <array>
#include <cstddef>

namespace nilio::tools::simulate {

/// From data sheets: range, range for 10 % reflectivity, full beam divergence.
struct Optics {
  double max_range_m = 100.0;
  double dark_range_m = 50.0;
  /// Across; the ideal sensor's edge in dual return mode.
  double divergence_rad = 0.003;
  double divergence_up_rad = 0.0015;
};
Optics optics_of(drivers::VelodyneModel model);
bool is_hdl64e(drivers::VelodyneModel model);

/// One ray of a footprint: offsets from the middle of the beam and share of the light.
struct FootprintRay {
  double aside_rad = 0.0;
  double up_rad = 0.0;
  double share = 0.0;
};
inline constexpr std::size_t kFootprintRays = 7;
/// Seven rays with the light and the second moment of a Gaussian beam: the middle and a hexagon turned by
/// `turn_rad`.
std::array<FootprintRay, kFootprintRays> footprint_rays(const Optics& optics, double turn_rad);

}  // namespace nilio::tools::simulate
