#pragma once

#include "nilio/core/result.hpp"

#include "tools/evaluate/metrics.hpp"
#include "tools/evaluate/trajectory.hpp"
#include "tools/plot/figure.hpp"

#include <optional>
#include <vector>

namespace nilio::tools {

/// Which two axes are seen from above.
enum class PlotPlane {
  kAuto,  ///< kXz for KITTI camera poses
  kXy,
  kXz,  ///< of a camera
};

struct TrajectoryFigureOptions {
  Alignment alignment = Alignment::kOrigin;
  PlotPlane plane = PlotPlane::kAuto;
};

/// The trajectories from above; with a truth they are moved onto it and have their errors drawn, too. The
/// legend calls them by their `path`. The map is moved with the first of the one or more estimates. An error
/// when an estimate does not overlap the truth.
core::Result<PlotFigure> trajectory_figure(const std::vector<Trajectory>& estimates,
                                           const std::optional<Trajectory>& truth,
                                           std::vector<Eigen::Vector3f> map,
                                           const TrajectoryFigureOptions& options);

}  // namespace nilio::tools
