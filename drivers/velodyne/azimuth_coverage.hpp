#pragma once

#include "drivers/velodyne/blind_sector.hpp"

#include <bitset>
#include <cstdint>

namespace nilio::drivers {

/// Azimuth that the firings of a scan surround.
///
/// Evenly lost packets thin a scan out; a missing sector makes it partial. A gap counts as thinned out when
/// chance explains it: with a share p of the packets lost elsewhere in the scan, a run of k lost ones occurs
/// in n packets about n p^k times (Erdős and Rényi 1970). A gap that fewer than one scan in a thousand would
/// have by chance, or of half a revolution, is a missing sector. Without other losses that is every gap of
/// more than one packet.
class AzimuthCoverage {
 public:
  void restart() { fired_.reset(); }
  /// A step at `azimuth` that holds up to the next one, `advance` later (0.01 degree).
  void add(std::uint16_t azimuth, float advance);
  /// Degrees of the field of view (the circle without the blind sector) less its missing sectors.
  /// `packet_deg`: azimuth of one packet.
  [[nodiscard]] double covered_deg(double packet_deg, const BlindSector& blind) const;

 private:
  /// Bins of a degree: steps are narrower at every speed.
  static constexpr int kBins = 360;

  std::bitset<kBins> fired_;
};

}  // namespace nilio::drivers
