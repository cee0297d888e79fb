#pragma once

#include "nilio/core/result.hpp"

#include "tools/common/trajectory.hpp"
#include "tools/evaluate/error_series.hpp"
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

/// Content of a panel.
enum class PanelKind {
  kTop,        ///< trajectories from above, with the map
  kError,      ///< position error over the distance travelled
  kApe,        ///< position error over time
  kRotation,   ///< rotation error over time
  kRpe,        ///< relative position error over time
  kXyz,        ///< three panels
  kRpy,        ///< roll, pitch and yaw: three panels
  kHistogram,  ///< of the position errors, with the same bins for all
};

struct TrajectoryFigureOptions {
  evaluate::Alignment alignment = evaluate::Alignment::kOrigin;
  Plane plane = Plane::kAuto;
  std::vector<PanelKind> panels = {};  ///< none: kTop, and kError with a truth
  evaluate::RelativeStep relative_step = {};
  bool colour_by_error = false;  ///< the trajectories of the top view by their position error
  std::string title = {};
};

/// Panels of the trajectories. With a truth the estimates are aligned to it. Curves are named by
/// Trajectory::path. The map is moved with the first estimate; there has to be one. Fails when an estimate
/// does not overlap the truth, and when a panel of errors is asked for without a truth.
core::Result<Figure> trajectory_figure(const std::vector<Trajectory>& estimates,
                                       const std::optional<Trajectory>& truth,
                                       std::vector<Eigen::Vector3f> map,
                                       const TrajectoryFigureOptions& options);

/// Compares the direction of travel in body axes: along z for a camera, along x for a vehicle or a LiDAR.
/// Returns a message when both kinds occur, which cannot share a picture; trajectories that hardly move fit
/// both. A map is z up: `has_map` does not fit camera poses.
std::optional<std::string> find_mixed_frames(const std::vector<Trajectory>& estimates,
                                             const std::optional<Trajectory>& truth, bool has_map = false);

}  // namespace nilio::tools::plot
