#pragma once

#include "nilio/core/result.hpp"

#include "tools/common/trajectory.hpp"
#include "tools/evaluate/metrics.hpp"
#include "tools/plot/figure.hpp"

#include <optional>
#include <string>
#include <vector>

namespace nilio::tools::plot {

/// The two axes of a top view.
enum class Plane {
  kAuto,  ///< kXz for KITTI camera poses, otherwise kXy
  kXy,
  kXz,  ///< of a camera
};

struct TrajectoryFigureOptions {
  evaluate::Alignment alignment = evaluate::Alignment::kOrigin;
  Plane plane = Plane::kAuto;
};

/// Top view of the trajectories. With a truth they are aligned to it, and a second panel has their position
/// errors. Curves are named by Trajectory::path. The map is moved with the first estimate; there has to be
/// one. Fails when an estimate does not overlap the truth.
core::Result<Figure> trajectory_figure(const std::vector<Trajectory>& estimates,
                                       const std::optional<Trajectory>& truth,
                                       std::vector<Eigen::Vector3f> map,
                                       const TrajectoryFigureOptions& options);

/// Compares the direction of travel in body axes: along z for a camera, along x for a vehicle or a LiDAR.
/// Returns a message when both kinds occur, which cannot share a picture; trajectories that hardly move fit
/// both.
std::optional<std::string> find_mixed_frames(const std::vector<Trajectory>& estimates,
                                             const std::optional<Trajectory>& truth);

}  // namespace nilio::tools::plot
