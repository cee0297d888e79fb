#pragma once

#include "tools/plot/canvas.hpp"

#include <optional>
#include <string>
#include <vector>

namespace nilio::tools {

struct PlotCurve {
  /// For the legend.
  std::string name;
  std::vector<Eigen::Vector2d> points;
};

/// What `nilio plot` draws; all coordinates in metres.
struct PlotFigure {
  std::string x_label;
  std::string y_label;
  std::optional<PlotCurve> truth;
  std::vector<PlotCurve> estimates;
  /// Position error over the distance travelled, as many as estimates or none.
  std::vector<PlotCurve> errors;
  /// Map points seen from above (x, y) and their height.
  std::vector<Eigen::Vector3f> map;
};

/// Top view with equal scales, and below or beside it the errors, whichever leaves more room.
void draw_figure(Canvas& canvas, const PlotFigure& figure);

/// The colour of the curve with this index in a picture; they repeat after ten.
const Colour& curve_colour(std::size_t index);

/// Map points on the pixels of `axes`: colour by height, opacity by density.
Raster rasterise_map(const std::vector<Eigen::Vector3f>& points, const Axes& axes);

}  // namespace nilio::tools
