#pragma once

#include "tools/plot/canvas.hpp"
#include "tools/plot/figure.hpp"

#include <string>
#include <utility>
#include <vector>

namespace nilio::tools {

struct ChartAxis {
  std::string label;
  /// Values have to be positive; those that are not are left out.
  bool logarithmic = false;
  /// Begins at zero at the latest; not for a logarithmic one.
  bool from_zero = false;
  /// Where to write what; empty: round numbers.
  std::vector<std::pair<double, std::string>> ticks;
};

/// Curves over a common axis, whatever their units.
struct Chart {
  ChartAxis x;
  ChartAxis y;
  std::vector<PlotCurve> curves;
  /// Marks every point: for few of them.
  bool marked = false;
};

/// Fills the canvas; axes reach as far as the curves.
void draw_chart(Canvas& canvas, const Chart& chart);

}  // namespace nilio::tools
