#include "tools/plot/figure.hpp"

#include "tools/plot/map.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>
#include <span>
#include <sstream>
#include <utility>

namespace nilio::tools::plot {

namespace {

constexpr Colour kInk{0.15, 0.15, 0.15};
constexpr Colour kPaper{0.985, 0.985, 0.985};
constexpr Colour kGrid{0.0, 0.0, 0.0, 0.12};
constexpr Colour kFrame{0.55, 0.55, 0.55};
constexpr Colour kReference{0.5, 0.5, 0.5};
/// Okabe and Ito's colours for all kinds of colour vision, with a darker yellow.
constexpr std::array<Colour, kMaxCurves> kCurveColours{{{0.00, 0.45, 0.70},
                                                        {0.84, 0.37, 0.00},
                                                        {0.00, 0.62, 0.45},
                                                        {0.80, 0.47, 0.65},
                                                        {0.00, 0.00, 0.00},
                                                        {0.90, 0.62, 0.00},
                                                        {0.34, 0.71, 0.91},
                                                        {0.60, 0.56, 0.10}}};
constexpr double kLeft = 90.0;
constexpr double kTop = 24.0;
constexpr double kBottom = 62.0;
constexpr double kRight = 24.0;
constexpr double kLabelGap = 14.0;
constexpr double kLabelRow = 18.0;
constexpr double kTitleHeight = 30.0;
const TextStyle kLabelStyle{.size = 14.0};

using Points = std::vector<Eigen::Vector2d>;
using Ticks = std::vector<std::pair<double, std::string>>;

std::string number_text(double value) {
  std::array<char, 32> text{};
  // Adding zero turns -0 into 0.
  std::snprintf(text.data(), text.size(), "%g", value + 0.0);
  return text.data();
}

struct Range {
  double low = std::numeric_limits<double>::infinity();
  double high = -low;

  void add(double value) {
    low = std::min(low, value);
    high = std::max(high, value);
  }
  [[nodiscard]] double extent() const { return high - low; }
  void widen(double margin) {
    low -= margin;
    high += margin;
  }
  /// Adds a share of the extent at both ends, and some room where there is no extent or no value.
  void widen_by_share(double share) {
    if (low > high) low = high = 0.0;
    widen(extent() > 0.0 ? share * extent() : std::max(0.1 * std::abs(low), 0.1));
  }
};

/// Panel in the coordinates that are drawn: logarithms on a logarithmic axis.
struct DrawnPanel {
  const Panel* panel = nullptr;
  std::vector<Points> curves;
  std::vector<std::vector<double>> shades;  ///< of the points of each curve
  Points reference;
  Range x;
  Range y;
};

std::optional<double> coordinate(const Axis& axis, double value) {
  if (!std::isfinite(value) || (axis.logarithmic && value <= 0.0)) return std::nullopt;
  return axis.logarithmic ? std::log10(value) : value;
}

DrawnPanel prepare(const Panel& panel) {
  DrawnPanel drawn;
  drawn.panel = &panel;
  const auto convert = [&](const Curve& curve, std::vector<double>* shades = nullptr) {
    Points points;
    for (std::size_t i = 0; i < curve.points.size(); ++i) {
      const Eigen::Vector2d& point = curve.points[i];
      const auto x = coordinate(panel.x, point.x());
      const auto y = coordinate(panel.y, point.y());
      if (!x || !y) continue;
      points.emplace_back(*x, *y);
      if (shades != nullptr && i < curve.shades.size()) shades->push_back(curve.shades[i]);
      drawn.x.add(*x);
      drawn.y.add(*y);
    }
    return points;
  };
  if (panel.reference) drawn.reference = convert(*panel.reference);
  for (const Curve& curve : panel.curves) {
    std::vector<double> shades;
    drawn.curves.push_back(convert(curve, &shades));
    drawn.shades.push_back(std::move(shades));
  }
  if (panel.is_top_view) {
    // With a map, the surroundings of the road are shown too.
    const double extent = std::max({drawn.x.extent(), drawn.y.extent(), 0.0});
    const double margin = panel.map.empty() ? std::max(0.06 * extent, 0.5) : std::max(0.1 * extent, 25.0);
    drawn.x.widen_by_share(0.0);
    drawn.y.widen_by_share(0.0);
    drawn.x.widen(margin);
    drawn.y.widen(margin);
  } else {
    drawn.x.widen_by_share(panel.markers ? 0.04 : 0.0);
    const bool starts_at_zero = panel.y.from_zero && !panel.y.logarithmic && drawn.y.low >= 0.0;
    drawn.y.widen_by_share(0.08);
    if (starts_at_zero) drawn.y.low = 0.0;
  }
  return drawn;
}

Ticks ticks_of(const Axis& axis, const Range& range, int max_parts) {
  Ticks ticks;
  const auto add = [&](double value, const std::string& text) {
    const auto at = coordinate(axis, value);
    if (at && *at >= range.low && *at <= range.high) ticks.emplace_back(*at, text);
  };
  if (!axis.ticks.empty()) {
    for (const auto& [value, text] : axis.ticks) add(value, text);
  } else if (axis.logarithmic) {
    for (double decade = std::floor(range.low); decade <= range.high; decade += 1.0) {
      for (const double factor : {1.0, 2.0, 5.0})
        add(factor * std::pow(10.0, decade), number_text(factor * std::pow(10.0, decade)));
    }
  } else {
    const double step = nice_step(range.extent(), max_parts);
    for (double i = std::ceil(range.low / step); i * step <= range.high; i += 1.0)
      add(i * step, number_text(i * step));
  }
  return ticks;
}

void draw_axes(Canvas& canvas, const Axes& axes, const Panel& panel) {
  const Rectangle& area = axes.area;
  for (const auto& [at, text] :
       ticks_of(panel.x, {axes.x_min, axes.x_max}, std::max(2, static_cast<int>(area.width / 80.0)))) {
    const double x = axes.to_pixel({at, axes.y_min}).x();
    canvas.line(std::array{Eigen::Vector2d(x, area.y), Eigen::Vector2d(x, area.bottom())}, kGrid, 1.0);
    canvas.text(text, {x, area.bottom() + 19.0}, {.size = 13.0, .align = TextAlign::kCentre});
  }
  for (const auto& [at, text] :
       ticks_of(panel.y, {axes.y_min, axes.y_max}, std::max(2, static_cast<int>(area.height / 42.0)))) {
    const double y = axes.to_pixel({axes.x_min, at}).y();
    canvas.line(std::array{Eigen::Vector2d(area.x, y), Eigen::Vector2d(area.right(), y)}, kGrid, 1.0);
    canvas.text(text, {area.x - 8.0, y + 4.5}, {.size = 13.0, .align = TextAlign::kRight});
  }
  const std::array frame{Eigen::Vector2d(area.x, area.y), Eigen::Vector2d(area.right(), area.y),
                         Eigen::Vector2d(area.right(), area.bottom()), Eigen::Vector2d(area.x, area.bottom()),
                         Eigen::Vector2d(area.x, area.y)};
  canvas.line(frame, kFrame, 1.0);
  canvas.text(panel.x.label, {area.x + 0.5 * area.width, area.bottom() + 44.0},
              {.size = 15.0, .align = TextAlign::kCentre});
  canvas.text(panel.y.label, {area.x - 64.0, area.y + 0.5 * area.height},
              {.size = 15.0, .align = TextAlign::kCentre, .vertical = true});
}

void draw_scale_bar(Canvas& canvas, const Axes& axes) {
  const double length_m = nice_step(axes.x_max - axes.x_min, 8);
  const double length = length_m * axes.area.width / (axes.x_max - axes.x_min);
  const double right = axes.area.right() - 24.0;
  const double y = axes.area.bottom() - 22.0;
  canvas.fill({right - length - 12.0, y - 28.0, length + 24.0, 40.0}, {1.0, 1.0, 1.0, 0.8});
  canvas.fill({right - length, y - 2.0, length, 4.0}, kInk);
  canvas.fill({right - length, y - 6.0, 2.0, 12.0}, kInk);
  canvas.fill({right - 2.0, y - 6.0, 2.0, 12.0}, kInk);
  canvas.text(number_text(length_m) + " m", {right - 0.5 * length, y - 10.0},
              {.size = 14.0, .align = TextAlign::kCentre});
}

/// Name of a curve beside its end.
struct Label {
  std::string text;
  Colour colour;
  Eigen::Vector2d end;  ///< pixel of the curve's last point
  double y = 0.0;
};

/// Moves labels apart, in the order of their curves' ends.
void place_labels(std::vector<Label>& labels, const Rectangle& area) {
  std::sort(labels.begin(), labels.end(),
            [](const Label& a, const Label& b) { return a.end.y() < b.end.y(); });
  double free_y = area.y + 5.0;
  for (Label& label : labels) {
    label.y = std::max(label.end.y(), free_y);
    free_y = label.y + kLabelRow;
  }
  double limit = area.bottom();
  for (auto label = labels.rbegin(); label != labels.rend(); ++label) {
    label->y = std::min(label->y, limit);
    limit = label->y - kLabelRow;
  }
}

void draw_labels(Canvas& canvas, std::vector<Label> labels, const Rectangle& area) {
  place_labels(labels, area);
  for (const Label& label : labels) {
    Colour faint = label.colour;
    faint.alpha = 0.45;
    canvas.line(std::array{label.end, Eigen::Vector2d(area.right() + kLabelGap - 4.0, label.y)}, faint, 1.0);
    TextStyle style = kLabelStyle;
    style.colour = label.colour;
    canvas.text(label.text, {area.right() + kLabelGap, label.y + 5.0}, style);
  }
}

/// Cividis (Nunez, Anderton and Renslow 2018), nine stops, without its lightest end.
Colour shade_colour(double shade) {
  constexpr std::array<Colour, 9> kStops{{{0.00, 0.13, 0.32},
                                          {0.07, 0.21, 0.43},
                                          {0.24, 0.30, 0.43},
                                          {0.38, 0.38, 0.44},
                                          {0.50, 0.49, 0.46},
                                          {0.60, 0.58, 0.47},
                                          {0.73, 0.69, 0.44},
                                          {0.84, 0.78, 0.39},
                                          {0.93, 0.84, 0.28}}};
  const double at = std::clamp(shade, 0.0, 1.0) * (kStops.size() - 1);
  const auto i = std::min(static_cast<std::size_t>(at), kStops.size() - 2);
  const double rest = at - static_cast<double>(i);
  const auto mix = [rest](double a, double b) { return a + rest * (b - a); };
  return {mix(kStops[i].red, kStops[i + 1].red), mix(kStops[i].green, kStops[i + 1].green),
          mix(kStops[i].blue, kStops[i + 1].blue)};
}

/// Pieces of a curve of one colour each, of so many colours that the steps do not show.
void draw_shaded(Canvas& canvas, const Points& points, const std::vector<double>& shades) {
  constexpr double kSteps = 32.0;
  for (std::size_t begin = 0; begin + 1 < points.size();) {
    const double step = std::round(kSteps * shades[begin + 1]);
    std::size_t end = begin + 1;
    while (end + 1 < points.size() && std::round(kSteps * shades[end + 1]) == step) ++end;
    canvas.line(std::span(points).subspan(begin, end - begin + 1), shade_colour(step / kSteps), 4.0);
    begin = end;
  }
}

/// Bar of the colours of a panel with its values, in a corner.
void draw_key(Canvas& canvas, const ColourKey& key, const Rectangle& area) {
  constexpr double kWidth = 200.0;
  const Rectangle bar{area.x + 24.0, area.bottom() - 40.0, kWidth, 10.0};
  canvas.fill({bar.x - 12.0, bar.y - 28.0, kWidth + 24.0, 64.0}, {1.0, 1.0, 1.0, 0.85});
  for (int i = 0; i < 50; ++i)
    canvas.fill({bar.x + i * kWidth / 50.0, bar.y, kWidth / 50.0 + 0.5, bar.height}, shade_colour(i / 49.0));
  canvas.text(key.label, {bar.x, bar.y - 9.0}, {.size = 13.0});
  canvas.text(number_text(key.low), {bar.x, bar.bottom() + 17.0}, {.size = 13.0});
  canvas.text(number_text(key.middle), {bar.x + 0.5 * kWidth, bar.bottom() + 17.0},
              {.size = 13.0, .align = TextAlign::kCentre});
  canvas.text(number_text(key.high), {bar.right(), bar.bottom() + 17.0},
              {.size = 13.0, .align = TextAlign::kRight});
}

/// Room for the names at the right side of a panel.
double label_width(Canvas& canvas, const Panel& panel) {
  double width = panel.reference ? canvas.text_width(panel.reference->name, kLabelStyle) : 0.0;
  for (const Curve& curve : panel.curves) width = std::max(width, canvas.text_width(curve.name, kLabelStyle));
  return width > 0.0 ? width + kLabelGap + 8.0 : kRight;
}

/// Axes of a panel within its part of the picture; those of a top view have equal scales.
Axes make_axes(Canvas& canvas, const DrawnPanel& drawn, const Rectangle& cell) {
  const double right = std::min(label_width(canvas, *drawn.panel), 0.5 * cell.width);
  const Rectangle area{cell.x + kLeft, cell.y + kTop, cell.width - kLeft - right,
                       cell.height - kTop - kBottom};
  Range x = drawn.x;
  Range y = drawn.y;
  if (drawn.panel->is_top_view) {
    const double scale = std::min(area.width / x.extent(), area.height / y.extent());
    x.widen(0.5 * (area.width / scale - x.extent()));
    y.widen(0.5 * (area.height / scale - y.extent()));
  }
  return {area, x.low, x.high, y.low, y.high};
}

void draw_panel(Canvas& canvas, const DrawnPanel& drawn, const Axes& axes) {
  const Panel& panel = *drawn.panel;
  const auto to_pixels = [&axes](Points points) {
    for (Eigen::Vector2d& point : points) point = axes.to_pixel(point);
    return points;
  };
  canvas.fill(axes.area, kPaper);
  if (!panel.map.empty()) canvas.raster(rasterise_map(panel.map, axes), axes.area);
  draw_axes(canvas, axes, panel);
  std::vector<Label> labels;
  canvas.clip(axes.area);
  if (!drawn.reference.empty()) {
    const Points points = to_pixels(drawn.reference);
    canvas.line(points, kReference, 6.0);
    labels.push_back({panel.reference->name, kReference, points.back()});
  }
  // In reverse order: the first curve is drawn over the others.
  for (std::size_t i = drawn.curves.size(); i-- > 0;) {
    if (drawn.curves[i].empty()) continue;
    const Points points = to_pixels(drawn.curves[i]);
    if (drawn.shades[i].size() == points.size() && points.size() > 1) {
      draw_shaded(canvas, points, drawn.shades[i]);
    } else {
      canvas.line(points, kCurveColours[i], 2.2);
    }
    if (panel.markers) {
      for (const Eigen::Vector2d& point : points) canvas.disc(point, 4.0, kCurveColours[i], kWhite);
    }
    if (panel.is_top_view) canvas.disc(points.back(), 5.0, kCurveColours[i], kWhite);
    if (panel.is_top_view && i == 0) canvas.disc(points.front(), 6.0, kWhite, kInk);
    labels.push_back({panel.curves[i].name, kCurveColours[i], points.back()});
  }
  canvas.unclip();
  if (panel.is_top_view) draw_scale_bar(canvas, axes);
  if (panel.key) draw_key(canvas, *panel.key, axes.area);
  draw_labels(canvas, std::move(labels), axes.area);
}

/// A top view at the left, the others in columns of three.
std::vector<Rectangle> arrange_columns(const Rectangle& whole, const std::vector<DrawnPanel>& panels) {
  constexpr std::size_t kRows = 3;
  const bool has_top = panels.front().panel->is_top_view;
  const std::size_t others = panels.size() - (has_top ? 1 : 0);
  const std::size_t columns = (others + kRows - 1) / kRows;
  const std::size_t rows = (others + columns - 1) / columns;
  const double left = !has_top ? 0.0 : columns == 1 ? 0.55 * whole.width : 0.4 * whole.width;
  std::vector<Rectangle> cells;
  if (has_top) cells.push_back({whole.x, whole.y, left, whole.height});
  const double width = (whole.width - left) / static_cast<double>(columns);
  const double height = whole.height / static_cast<double>(rows);
  for (std::size_t i = 0; i < others; ++i)
    cells.push_back({whole.x + left + width * static_cast<double>(i / rows),
                     whole.y + height * static_cast<double>(i % rows), width, height});
  return cells;
}

/// Parts of the picture for the panels.
std::vector<Rectangle> arrange(Canvas& canvas, const std::vector<DrawnPanel>& panels, double top) {
  const Rectangle whole{0.0, top, canvas.width(), canvas.height() - top};
  if (panels.size() < 2) return {whole};
  if (panels.size() > 2) return arrange_columns(whole, panels);
  if (!panels.front().panel->is_top_view) {
    const double half = 0.5 * whole.width;
    return {{0.0, top, half, whole.height}, {half, top, half, whole.height}};
  }
  const double left = 0.62 * whole.width;
  const double upper = 0.68 * whole.height;
  const std::vector<Rectangle> beside{{0.0, top, left, whole.height},
                                      {left, top, whole.width - left, whole.height}};
  const std::vector<Rectangle> below{{0.0, top, whole.width, upper},
                                     {0.0, top + upper, whole.width, whole.height - upper}};
  const auto metres_per_pixel = [&](const Rectangle& cell) {
    const Axes axes = make_axes(canvas, panels.front(), cell);
    return (axes.x_max - axes.x_min) / axes.area.width;
  };
  return metres_per_pixel(below.front()) < metres_per_pixel(beside.front()) ? below : beside;
}

}  // namespace

core::Result<std::string> save_figure(const Figure& figure, const std::string& path, int width, int height) {
  auto canvas = Canvas::create(path, width, height);
  if (!canvas) return canvas.error();
  canvas->fill({0.0, 0.0, canvas->width(), canvas->height()}, kWhite);
  std::vector<DrawnPanel> panels;
  for (const Panel& panel : figure.panels) {
    if (panel.curves.size() > kMaxCurves)
      return core::Error{path + ": " + std::to_string(panel.curves.size()) +
                         " curves cannot be distinguished in one picture - draw at most " +
                         std::to_string(kMaxCurves)};
    panels.push_back(prepare(panel));
  }
  const double top = figure.title.empty() ? 0.0 : kTitleHeight;
  if (top > 0.0)
    canvas->text(figure.title, {0.5 * canvas->width(), 32.0},
                 {.size = 20.0, .align = TextAlign::kCentre, .bold = true});
  const std::vector<Rectangle> cells = arrange(*canvas, panels, top);
  for (std::size_t i = 0; i < panels.size(); ++i)
    draw_panel(*canvas, panels[i], make_axes(*canvas, panels[i], cells[i]));
  return canvas->save();
}

std::string figure_csv(const Figure& figure) {
  std::ostringstream text;
  text << "panel,curve,x,y\n";
  for (std::size_t i = 0; i < figure.panels.size(); ++i) {
    const auto add = [&](const Curve& curve) {
      for (const Eigen::Vector2d& point : curve.points)
        text << i + 1 << ",\"" << curve.name << "\"," << point.x() << ',' << point.y() << '\n';
    };
    if (figure.panels[i].reference) add(*figure.panels[i].reference);
    for (const Curve& curve : figure.panels[i].curves) add(curve);
  }
  return text.str();
}

Eigen::Vector2d Axes::to_pixel(const Eigen::Vector2d& point) const {
  return {area.x + area.width * (point.x() - x_min) / (x_max - x_min),
          area.y + area.height * (y_max - point.y()) / (y_max - y_min)};
}

double nice_step(double range, int max_parts) {
  const double raw = range / max_parts;
  const double power = std::pow(10.0, std::floor(std::log10(raw)));
  for (const double factor : {1.0, 2.0, 5.0}) {
    if (factor * power >= raw * (1.0 - 1e-9)) return factor * power;
  }
  return 10.0 * power;
}

}  // namespace nilio::tools::plot
