#pragma once

#include "nilio/core/result.hpp"

#include "tools/plot/canvas.hpp"

#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace nilio::tools::plot {

/// More curves in one panel cannot be distinguished.
inline constexpr std::size_t kMaxCurves = 8;

struct Curve {
  std::string name;  ///< written beside the curve's end
  std::vector<Eigen::Vector2d> points;
  /// Values 0..1 of the points' colours on the panel's scale; empty: the curve's own colour.
  std::vector<double> shades = {};
};

/// Meaning of the shades of the curves of a panel: the values at 0, 0.5 and 1, with their unit.
struct ColourKey {
  std::string label;
  double low = 0.0;
  double middle = 0.0;
  double high = 1.0;
};

struct Axis {
  std::string label;
  bool logarithmic = false;  ///< values that are not positive are left out
  bool from_zero = false;    ///< the y axis starts at zero; not for negative values or a logarithmic axis
  /// Positions and texts of the ticks; empty = round numbers.
  std::vector<std::pair<double, std::string>> ticks = {};
};

/// Curves over common axes.
struct Panel {
  Axis x;
  Axis y;
  std::vector<Curve> curves;
  bool markers = false;  ///< marks every point
  /// The following are for maps seen from above: metres, the same scale on both axes.
  bool is_top_view = false;
  std::optional<Curve> reference;    ///< true trajectory, drawn wide and grey below the curves
  std::vector<Eigen::Vector3f> map;  ///< x, y and height of map points
  std::optional<ColourKey> key = {};
};

/// One or several panels. Two are side by side, or below each other where that makes a top view larger; more
/// are in columns of at most three, a top view beside them.
struct Figure {
  std::vector<Panel> panels;
  std::string title = {};
};

/// Draws the figure into a .png or .svg file. Fails when a panel has more than kMaxCurves curves or the file
/// cannot be written.
core::Result<std::string> save_figure(const Figure& figure, const std::string& path, int width, int height);

/// All points as lines "panel,curve,x,y" under a heading; maps are left out.
std::string figure_csv(const Figure& figure);

/// Data coordinates on a part of a canvas.
struct Axes {
  Rectangle area;
  double x_min = 0.0;
  double x_max = 1.0;
  double y_min = 0.0;
  double y_max = 1.0;

  [[nodiscard]] Eigen::Vector2d to_pixel(const Eigen::Vector2d& point) const;
};

/// Smallest step of 1, 2 or 5 times a power of ten that divides `range` into at most `max_parts`.
double nice_step(double range, int max_parts);

}  // namespace nilio::tools::plot
