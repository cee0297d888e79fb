#pragma once

#include "tools/mangle/faults.hpp"

#include <cstdint>
#include <span>
#include <vector>

#include <Eigen/Core>

namespace nilio::tools::mangle {

/// One return of a scan.
struct Return {
  Eigen::Vector3f position;  ///< sensor frame, x forward, metres
  unsigned ring = 0;         ///< 0 .. rings - 1
};

/// A return after the faults; range 0: it is missing.
struct EditedReturn {
  float range_m = 0.0F;
};

/// Returns that each fault met.
struct ReturnCounts {
  std::uint64_t returns = 0;
  std::uint64_t kept = 0;
  std::uint64_t other_rings = 0;
  std::uint64_t outside_view = 0;
  std::uint64_t not_vegetation = 0;
  std::uint64_t thinned = 0;
  std::uint64_t ghosts = 0;
};

/// Applies the faults of the returns to whole scans. One thread.
class ReturnFaults {
 public:
  /// `rings` of the sensor.
  ReturnFaults(const Faults& faults, unsigned rings);

  /// `out[i]` belongs to `scan[i]`. The same scan number and returns give the same result.
  void apply(std::span<const Return> scan, std::uint64_t number, std::vector<EditedReturn>& out);
  [[nodiscard]] const ReturnCounts& counts() const { return counts_; }

 private:
  [[nodiscard]] bool is_selected(const Return& given, bool vegetation);
  void thin(std::uint64_t number, std::vector<EditedReturn>& out);
  [[nodiscard]] float disturbed_range(float range_m, std::uint64_t number, std::uint64_t index);

  Faults faults_;
  std::vector<bool> kept_rings_;
  std::vector<bool> vegetation_;
  ReturnCounts counts_;
};

/// Whether each of `rings` rings remains when `kept` evenly spaced ones do; all for 0.
std::vector<bool> choose_rings(unsigned rings, unsigned kept);

/// Marks the returns of vegetation: those in voxels of 1 m with at least six returns whose smallest variance
/// is at least a tenth of the largest one ("scattering", Demantke et al. 2011), so that they lie neither on a
/// plane nor on a line.
std::vector<bool> find_vegetation(std::span<const Return> scan);

}  // namespace nilio::tools::mangle
