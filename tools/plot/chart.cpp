#include "tools/plot/chart.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>
#include <optional>

namespace nilio::tools {

namespace {

constexpr Colour kFrame{0.6, 0.6, 0.6};
constexpr double kLeft = 95.0;
constexpr double kRight = 30.0;
constexpr double kBottom = 65.0;
constexpr double kLegendRow = 24.0;

using Ticks = std::vector<std::pair<double, std::string>>;

std::string number_text(double value) {
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "%g", value);
  return text.data();
}

/// Coordinates that are drawn: logarithms on a logarithmic axis. Nothing for what has none.
std::optional<double> coordinate(const ChartAxis& axis, double value) {
  if (!std::isfinite(value) || (axis.logarithmic && value <= 0.0)) return std::nullopt;
  return axis.logarithmic ? std::log10(value) : value;
}

std::vector<Eigen::Vector2d> drawn_points(const Chart& chart, const PlotCurve& curve) {
  std::vector<Eigen::Vector2d> points;
  for (const Eigen::Vector2d& point : curve.points) {
    const auto x = coordinate(chart.x, point.x());
    const auto y = coordinate(chart.y, point.y());
    if (x && y) points.emplace_back(*x, *y);
  }
  return points;
}

struct Range {
  double low = std::numeric_limits<double>::infinity();
  double high = -low;

  void add(double value) {
    low = std::min(low, value);
    high = std::max(high, value);
  }
  /// Room at both ends, and for curves without extent or without points.
  void widen(double share) {
    if (low > high) low = high = 0.0;
    const double extent = high - low;
    const double room = extent > 0.0 ? share * extent : std::max(0.1 * std::abs(low), 0.1);
    low -= room;
    high += room;
  }
};

Ticks ticks_of(const ChartAxis& axis, const Range& range) {
  Ticks ticks;
  const auto add = [&](double value, const std::string& text) {
    const auto at = coordinate(axis, value);
    if (at && *at >= range.low && *at <= range.high) ticks.emplace_back(*at, text);
  };
  if (!axis.ticks.empty()) {
    for (const auto& [value, text] : axis.ticks) add(value, text);
  } else if (axis.logarithmic) {
    for (double decade = std::floor(range.low); decade <= range.high; decade += 1.0) {
      for (const double factor : {1.0, 2.0, 5.0}) {
        const double value = factor * std::pow(10.0, decade);
        add(value, number_text(value));
      }
    }
  } else {
    constexpr int most = 8;
    const double step = nice_step(range.high - range.low, most);
    for (double i = std::ceil(range.low / step); i * step <= range.high; i += 1.0)
      add(i * step, number_text(i * step));
  }
  return ticks;
}

void draw_grid(Canvas& canvas, const Axes& axes, const Chart& chart, const Ticks& x_ticks,
               const Ticks& y_ticks) {
  const Rectangle& area = axes.area;
  canvas.fill(area, kPaper);
  for (const auto& [at, text] : x_ticks) {
    const double x = axes.to_pixel({at, axes.y_min}).x();
    canvas.line(std::array{Eigen::Vector2d(x, area.y), Eigen::Vector2d(x, area.y + area.height)}, kGrid, 1.0);
    canvas.text(text, {x, area.y + area.height + 20.0}, {.size = 13.0, .align = TextAlign::kCentre});
  }
  for (const auto& [at, text] : y_ticks) {
    const double y = axes.to_pixel({axes.x_min, at}).y();
    canvas.line(std::array{Eigen::Vector2d(area.x, y), Eigen::Vector2d(area.x + area.width, y)}, kGrid, 1.0);
    canvas.text(text, {area.x - 8.0, y + 5.0}, {.size = 13.0, .align = TextAlign::kRight});
  }
  canvas.frame(area, kFrame, 1.0);
  canvas.text(chart.x.label, {area.x + 0.5 * area.width, area.y + area.height + 48.0},
              {.size = 15.0, .align = TextAlign::kCentre});
  canvas.text(chart.y.label, {24.0, area.y + 0.5 * area.height},
              {.size = 15.0, .align = TextAlign::kCentre, .vertical = true});
}

/// Rows of names above the chart; returns where it may begin.
double draw_names(Canvas& canvas, const Chart& chart) {
  double x = kLeft;
  double y = 28.0;
  for (std::size_t i = 0; i < chart.curves.size(); ++i) {
    const double width = 42.0 + canvas.text_width(chart.curves[i].name, {.size = 14.0}) + 26.0;
    if (x > kLeft && x + width > canvas.width() - kRight) {
      x = kLeft;
      y += kLegendRow;
    }
    canvas.line(std::array{Eigen::Vector2d(x, y - 5.0), Eigen::Vector2d(x + 34.0, y - 5.0)}, curve_colour(i),
                2.6);
    canvas.text(chart.curves[i].name, {x + 42.0, y}, {.size = 14.0});
    x += width;
  }
  return y + 18.0;
}

}  // namespace

void draw_chart(Canvas& canvas, const Chart& chart) {
  canvas.fill({0.0, 0.0, canvas.width(), canvas.height()}, kWhite);
  const double top = draw_names(canvas, chart);
  Range x_range;
  Range y_range;
  std::vector<std::vector<Eigen::Vector2d>> curves;
  for (const PlotCurve& curve : chart.curves) {
    curves.push_back(drawn_points(chart, curve));
    for (const Eigen::Vector2d& point : curves.back()) {
      x_range.add(point.x());
      y_range.add(point.y());
    }
  }
  x_range.widen(chart.marked ? 0.04 : 0.0);
  y_range.widen(0.08);
  if (chart.y.from_zero && !chart.y.logarithmic) y_range.low = std::min(y_range.low, 0.0);
  const Axes axes{{kLeft, top, canvas.width() - kLeft - kRight, canvas.height() - top - kBottom},
                  x_range.low,
                  x_range.high,
                  y_range.low,
                  y_range.high};
  draw_grid(canvas, axes, chart, ticks_of(chart.x, x_range), ticks_of(chart.y, y_range));
  canvas.clip(axes.area);
  for (std::size_t i = 0; i < curves.size(); ++i) {
    for (Eigen::Vector2d& point : curves[i]) point = axes.to_pixel(point);
    if (!curves[i].empty()) canvas.line(curves[i], curve_colour(i), 2.2);
    if (!chart.marked) continue;
    for (const Eigen::Vector2d& point : curves[i]) canvas.disc(point, 4.0, curve_colour(i), kWhite);
  }
  canvas.unclip();
}

}  // namespace nilio::tools
