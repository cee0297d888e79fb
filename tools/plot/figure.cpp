#include "tools/plot/figure.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace nilio::tools {

namespace {

constexpr Colour kTruthColour{0.45, 0.45, 0.45};
constexpr std::array<Colour, 10> kEstimateColours{{{0.12, 0.47, 0.71},
                                                   {0.90, 0.33, 0.05},
                                                   {0.17, 0.63, 0.17},
                                                   {0.58, 0.40, 0.74},
                                                   {0.84, 0.15, 0.16},
                                                   {0.55, 0.34, 0.29},
                                                   {0.09, 0.75, 0.81},
                                                   {0.89, 0.47, 0.76},
                                                   {0.74, 0.65, 0.05},
                                                   {0.10, 0.10, 0.10}}};
constexpr double kLeftMargin = 90.0;
constexpr double kRightMargin = 30.0;
constexpr double kBottomMargin = 60.0;
constexpr double kLegendRow = 26.0;

struct Bounds {
  Eigen::Vector2d min = Eigen::Vector2d::Constant(std::numeric_limits<double>::infinity());
  Eigen::Vector2d max = -min;

  void add(const std::vector<Eigen::Vector2d>& points) {
    for (const Eigen::Vector2d& point : points) {
      min = min.cwiseMin(point);
      max = max.cwiseMax(point);
    }
  }
};

Bounds trajectory_bounds(const PlotFigure& figure) {
  Bounds bounds;
  if (figure.truth) bounds.add(figure.truth->points);
  for (const PlotCurve& estimate : figure.estimates) bounds.add(estimate.points);
  // With a map, enough of what stands beside the road.
  const Eigen::Vector2d extent = bounds.max - bounds.min;
  const double margin =
      figure.map.empty() ? std::max(0.06 * extent.maxCoeff(), 0.5) : std::max(0.1 * extent.maxCoeff(), 25.0);
  bounds.min.array() -= margin;
  bounds.max.array() += margin;
  return bounds;
}

/// Axes with equal scales that show all of `bounds` in the middle of `area`.
Axes fit_equal(const Rectangle& area, const Bounds& bounds) {
  const Eigen::Vector2d extent = bounds.max - bounds.min;
  const double scale = std::min(area.width / extent.x(), area.height / extent.y());
  const Eigen::Vector2d centre = 0.5 * (bounds.min + bounds.max);
  const double half_width = 0.5 * area.width / scale;
  const double half_height = 0.5 * area.height / scale;
  return {area, centre.x() - half_width, centre.x() + half_width, centre.y() - half_height,
          centre.y() + half_height};
}

struct Layout {
  Rectangle top_view;
  std::optional<Rectangle> errors;
};

Layout make_layout(const Canvas& canvas, const PlotFigure& figure, double top) {
  const double width = canvas.width() - kLeftMargin - kRightMargin;
  const double height = canvas.height() - top - kBottomMargin;
  const Rectangle whole{kLeftMargin, top, width, height};
  if (figure.errors.empty()) return {whole, std::nullopt};
  const Bounds bounds = trajectory_bounds(figure);
  const Eigen::Vector2d extent = bounds.max - bounds.min;
  constexpr double gap = 95.0;
  const double beside = std::round(0.30 * width);
  const double below = std::round(0.26 * height);
  const Rectangle left{whole.x, whole.y, width - beside - gap, height};
  const Rectangle upper{whole.x, whole.y, width, height - below - gap + 20.0};
  const auto scale_in = [&](const Rectangle& area) {
    return std::min(area.width / extent.x(), area.height / extent.y());
  };
  if (scale_in(upper) > scale_in(left)) {
    return {upper, Rectangle{whole.x, whole.y + height - below, width, below}};
  }
  return {left, Rectangle{whole.x + width - beside, whole.y, beside, height}};
}

std::vector<Eigen::Vector2d> to_pixels(const Axes& axes, const std::vector<Eigen::Vector2d>& points) {
  std::vector<Eigen::Vector2d> pixels;
  pixels.reserve(points.size());
  for (const Eigen::Vector2d& point : points) pixels.push_back(axes.to_pixel(point));
  return pixels;
}

void draw_scale_bar(Canvas& canvas, const Axes& axes) {
  const double length_m = nice_step(axes.x_max - axes.x_min, 8);
  const double length = length_m * axes.pixels_per_x();
  const double right = axes.area.x + axes.area.width - 24.0;
  const double y = axes.area.y + axes.area.height - 22.0;
  canvas.fill({right - length - 12.0, y - 28.0, length + 24.0, 40.0}, {1.0, 1.0, 1.0, 0.8});
  constexpr Colour ink{0.15, 0.15, 0.15};
  canvas.fill({right - length, y - 2.0, length, 4.0}, ink);
  canvas.fill({right - length, y - 6.0, 2.0, 12.0}, ink);
  canvas.fill({right - 2.0, y - 6.0, 2.0, 12.0}, ink);
  std::array<char, 64> text{};
  std::snprintf(text.data(), text.size(), "%g m", length_m);
  canvas.text(text.data(), {right - 0.5 * length, y - 10.0}, {.size = 14.0, .align = TextAlign::kCentre});
}

void draw_top_view(Canvas& canvas, const PlotFigure& figure, const Rectangle& area) {
  const Axes axes = fit_equal(area, trajectory_bounds(figure));
  canvas.fill(area, kPaper);
  if (!figure.map.empty()) canvas.raster(rasterise_map(figure.map, axes), area);
  draw_axes(canvas, axes, figure.x_label, figure.y_label);
  canvas.clip(area);
  if (figure.truth) canvas.line(to_pixels(axes, figure.truth->points), kTruthColour, 6.0);
  for (std::size_t i = 0; i < figure.estimates.size(); ++i) {
    canvas.line(to_pixels(axes, figure.estimates[i].points), curve_colour(i), 2.2);
  }
  for (std::size_t i = 0; i < figure.estimates.size(); ++i) {
    canvas.disc(axes.to_pixel(figure.estimates[i].points.back()), 5.0, curve_colour(i), kWhite);
  }
  if (!figure.estimates.empty()) {
    canvas.disc(axes.to_pixel(figure.estimates.front().points.front()), 6.0, kWhite, {0.1, 0.1, 0.1});
  }
  canvas.unclip();
  draw_scale_bar(canvas, axes);
}

void draw_errors(Canvas& canvas, const PlotFigure& figure, const Rectangle& area) {
  Bounds bounds;
  for (const PlotCurve& curve : figure.errors) bounds.add(curve.points);
  const Axes axes{area, 0.0, std::max(bounds.max.x(), 1e-3), 0.0, std::max(1.08 * bounds.max.y(), 1e-3)};
  canvas.fill(area, kPaper);
  draw_axes(canvas, axes, "distance travelled [m]", "position error [m]");
  canvas.clip(area);
  for (std::size_t i = 0; i < figure.errors.size(); ++i) {
    canvas.line(to_pixels(axes, figure.errors[i].points), curve_colour(i), 2.0);
  }
  canvas.unclip();
}

/// Rows of names above the picture; returns the height used.
double draw_legend(Canvas& canvas, const PlotFigure& figure) {
  struct Item {
    const PlotCurve* curve;
    Colour colour;
    double line_width;
  };
  std::vector<Item> items;
  if (figure.truth) items.push_back({&*figure.truth, kTruthColour, 6.0});
  for (std::size_t i = 0; i < figure.estimates.size(); ++i) {
    items.push_back({&figure.estimates[i], curve_colour(i), 2.5});
  }
  constexpr double swatch_width = 34.0;
  const TextStyle style{.size = 15.0};
  double x = kLeftMargin;
  double y = 30.0;
  for (const Item& item : items) {
    const double width = swatch_width + 8.0 + canvas.text_width(item.curve->name, style) + 30.0;
    if (x > kLeftMargin && x + width > canvas.width() - kRightMargin) {
      x = kLeftMargin;
      y += kLegendRow;
    }
    const std::array<Eigen::Vector2d, 2> swatch{Eigen::Vector2d(x + 2.0, y - 5.0),
                                                Eigen::Vector2d(x + swatch_width - 2.0, y - 5.0)};
    canvas.line(swatch, item.colour, item.line_width);
    canvas.text(item.curve->name, {x + swatch_width + 8.0, y}, style);
    x += width;
  }
  return y + 16.0;
}

/// From deep blue over green to warm yellow, dark enough on white.
Colour height_colour(double share) {
  constexpr std::array<Colour, 5> stops{
      {{0.20, 0.25, 0.50}, {0.17, 0.48, 0.56}, {0.25, 0.65, 0.45}, {0.68, 0.74, 0.25}, {0.93, 0.69, 0.13}}};
  const double position = std::clamp(share, 0.0, 1.0) * (stops.size() - 1);
  const std::size_t i = std::min(static_cast<std::size_t>(position), stops.size() - 2);
  const double t = position - static_cast<double>(i);
  const auto mix = [t](double a, double b) { return a + t * (b - a); };
  return {mix(stops[i].red, stops[i + 1].red), mix(stops[i].green, stops[i + 1].green),
          mix(stops[i].blue, stops[i + 1].blue)};
}

std::uint32_t premultiplied(const Colour& colour, double alpha) {
  const auto byte = [](double value) { return static_cast<std::uint32_t>(std::lround(255.0 * value)); };
  return byte(alpha) << 24U | byte(alpha * colour.red) << 16U | byte(alpha * colour.green) << 8U |
         byte(alpha * colour.blue);
}

/// Heights between which the colours run: single points far up or down do not count.
std::pair<float, float> height_range(std::vector<float> heights) {
  const auto quantile = [&heights](double share) {
    const auto at =
        heights.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(heights.size() - 1));
    std::nth_element(heights.begin(), at, heights.end());
    return *at;
  };
  const float low = quantile(0.02);
  return {low, std::max(quantile(0.98), low + 0.1F)};
}

}  // namespace

const Colour& curve_colour(std::size_t index) { return kEstimateColours[index % kEstimateColours.size()]; }

Raster rasterise_map(const std::vector<Eigen::Vector3f>& points, const Axes& axes) {
  Raster raster{static_cast<int>(axes.area.width), static_cast<int>(axes.area.height), {}};
  const auto pixel_count = static_cast<std::size_t>(raster.width) * static_cast<std::size_t>(raster.height);
  raster.pixels.assign(pixel_count, 0);
  std::vector<std::uint32_t> counts(pixel_count, 0);
  std::vector<float> tops(pixel_count, -std::numeric_limits<float>::infinity());
  std::vector<float> heights;
  for (const Eigen::Vector3f& point : points) {
    const Eigen::Vector2d pixel =
        axes.to_pixel({point.x(), point.y()}) - Eigen::Vector2d(axes.area.x, axes.area.y);
    if (!(pixel.x() >= 0.0 && pixel.y() >= 0.0 && pixel.x() < raster.width && pixel.y() < raster.height)) {
      continue;
    }
    const std::size_t i = static_cast<std::size_t>(pixel.y()) * static_cast<std::size_t>(raster.width) +
                          static_cast<std::size_t>(pixel.x());
    ++counts[i];
    tops[i] = std::max(tops[i], point.z());
    heights.push_back(point.z());
  }
  if (heights.empty()) return raster;
  const auto [low, high] = height_range(std::move(heights));
  for (std::size_t i = 0; i < pixel_count; ++i) {
    if (counts[i] == 0) continue;
    const double alpha = std::min(0.85, 0.35 + 0.15 * std::log2(static_cast<double>(counts[i])));
    raster.pixels[i] =
        premultiplied(height_colour(static_cast<double>((tops[i] - low) / (high - low))), alpha);
  }
  return raster;
}

void draw_figure(Canvas& canvas, const PlotFigure& figure) {
  canvas.fill({0.0, 0.0, canvas.width(), canvas.height()}, kWhite);
  const double top = draw_legend(canvas, figure);
  const Layout layout = make_layout(canvas, figure, top);
  draw_top_view(canvas, figure, layout.top_view);
  if (layout.errors) draw_errors(canvas, figure, *layout.errors);
}

}  // namespace nilio::tools
