#pragma once

#include "nilio/core/scan.hpp"

#include "core/src/preprocessing/scan_filter.hpp"

#include <cstddef>
#include <vector>

namespace nilio::tests {

/// Points of a scan as a sweep without times, and their positions.
struct TestSweep {
  std::vector<core::SweepPoint> sweep;
  std::vector<Eigen::Vector3f> points;
};

/// Every `step`-th point of the scan of a sensor at base_link.
inline TestSweep sweep_of(const core::Scan& scan, std::size_t step = 1) {
  TestSweep result;
  for (std::size_t i = 0; i < scan.points.size(); i += step) {
    const core::Point& p = scan.points[i];
    result.points.emplace_back(p.x, p.y, p.z);
    result.sweep.push_back({result.points.back(), 0.0F, static_cast<float>(p.ring), p.intensity});
  }
  return result;
}

}  // namespace nilio::tests
