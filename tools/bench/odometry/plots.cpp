#include "tools/bench/odometry/plots.hpp"

#include "tools/bench/odometry/report.hpp"
#include "tools/plot/figure.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace nilio::tools {

namespace {

constexpr Colour kInk{0.15, 0.15, 0.15};
constexpr double kLabelWidth = 190.0;
constexpr double kTop = 70.0;
constexpr double kBottom = 70.0;
constexpr double kRight = 30.0;
// Few colours, none of them those of the curves beside.
constexpr std::array<Colour, kStages> kStageColours{
    {{0.55, 0.63, 0.71}, {0.93, 0.69, 0.13}, {0.20, 0.45, 0.60}, {0.62, 0.75, 0.55}}};

double longest_ms(std::span<const Measurement> measurements) {
  double longest = 1e-3;
  for (const Measurement& m : measurements) longest = std::max(longest, m.wall.total.max);
  return longest;
}

/// Milliseconds on a logarithmic scale from a tenth of the shortest to the longest: the methods lie decades
/// apart.
struct LogScale {
  double low = 0.1;
  double high = 1000.0;
  Rectangle area;

  [[nodiscard]] double to_x(double ms) const {
    const double share = std::log(std::max(ms, low) / low) / std::log(high / low);
    return area.x + area.width * share;
  }
};

LogScale make_scale(std::span<const Measurement> measurements, const Rectangle& area) {
  double shortest = longest_ms(measurements);
  for (const Measurement& m : measurements) {
    for (const double ms : m.wall.per_scan) shortest = std::min(shortest, std::max(ms, 1e-3));
  }
  return {std::pow(10.0, std::floor(std::log10(shortest))),
          std::pow(10.0, std::ceil(std::log10(1.001 * longest_ms(measurements)))), area};
}

void draw_log_grid(Canvas& canvas, const LogScale& scale) {
  const Rectangle& area = scale.area;
  canvas.fill(area, kPaper);
  for (double decade = scale.low; decade <= scale.high * 1.001; decade *= 10.0) {
    for (const double factor : {1.0, 2.0, 5.0}) {
      const double ms = decade * factor;
      if (ms > scale.high * 1.001) break;
      const double x = scale.to_x(ms);
      const std::array<Eigen::Vector2d, 2> line{Eigen::Vector2d(x, area.y),
                                                Eigen::Vector2d(x, area.y + area.height)};
      canvas.line(line, kGrid, 1.0);
      std::array<char, 32> text{};
      std::snprintf(text.data(), text.size(), "%g", ms);
      canvas.text(text.data(), {x, area.y + area.height + 20.0}, {.size = 13.0, .align = TextAlign::kCentre});
    }
  }
  canvas.frame(area, {0.6, 0.6, 0.6}, 1.0);
  canvas.text("wall time of a scan [ms]", {area.x + 0.5 * area.width, area.y + area.height + 46.0},
              {.size = 15.0, .align = TextAlign::kCentre});
}

/// Bars of the stages' median times, longest method last.
void draw_stages(Canvas& canvas, std::span<const Measurement> measurements, const Rectangle& area) {
  std::vector<const Measurement*> with_stages;
  for (const Measurement& m : measurements) {
    if (m.work.scans > 0) with_stages.push_back(&m);
  }
  double longest = 1e-3;
  for (const Measurement* m : with_stages) {
    double sum = 0.0;
    for (const Spread& stage : m->wall.stages) sum += stage.median;
    longest = std::max({longest, sum, m->wall.total.p99});
  }
  const Axes axes{area, 0.0, 1.08 * longest, 0.0, 1.0};
  canvas.fill(area, kPaper);
  const double step = nice_step(axes.x_max, 8);
  for (double ms = 0.0; ms <= axes.x_max; ms += step) {
    const double x = axes.to_pixel({ms, 0.0}).x();
    const std::array<Eigen::Vector2d, 2> line{Eigen::Vector2d(x, area.y),
                                              Eigen::Vector2d(x, area.y + area.height)};
    canvas.line(line, kGrid, 1.0);
    canvas.text(fixed(ms, step < 1.0 ? 1 : 0), {x, area.y + area.height + 20.0},
                {.size = 13.0, .align = TextAlign::kCentre});
  }
  const double row = area.height / static_cast<double>(std::max<std::size_t>(with_stages.size(), 1));
  for (std::size_t i = 0; i < with_stages.size(); ++i) {
    const Measurement& m = *with_stages[i];
    const double middle = area.y + (static_cast<double>(i) + 0.5) * row;
    const double height = std::min(34.0, 0.6 * row);
    canvas.text(label_of(m), {area.x - 12.0, middle + 5.0}, {.size = 15.0, .align = TextAlign::kRight});
    double ms = 0.0;
    for (std::size_t s = 0; s < kStages; ++s) {
      const double x = axes.to_pixel({ms, 0.0}).x();
      ms += m.wall.stages[s].median;
      canvas.fill({x, middle - 0.5 * height, axes.to_pixel({ms, 0.0}).x() - x, height}, kStageColours[s]);
    }
    const double p99 = axes.to_pixel({m.wall.total.p99, 0.0}).x();
    canvas.fill({p99 - 1.5, middle - 0.5 * height - 4.0, 3.0, height + 8.0}, kInk);
  }
  canvas.frame(area, {0.6, 0.6, 0.6}, 1.0);
  canvas.text("median of each stage, and 99 % of all scans [ms]",
              {area.x + 0.5 * area.width, area.y + area.height + 46.0},
              {.size = 15.0, .align = TextAlign::kCentre});
}

void draw_stage_legend(Canvas& canvas, double x) {
  constexpr double y = 36.0;
  for (std::size_t s = 0; s < kStages; ++s) {
    canvas.fill({x, y - 12.0, 22.0, 14.0}, kStageColours[s]);
    canvas.text(stage_name(s), {x + 29.0, y}, {.size = 15.0});
    x += 29.0 + canvas.text_width(stage_name(s), {.size = 15.0}) + 24.0;
  }
  canvas.fill({x, y - 15.0, 3.0, 20.0}, kInk);
  canvas.text("99 %", {x + 10.0, y}, {.size = 15.0});
}

void draw_shares(Canvas& canvas, std::span<const Measurement> measurements, const Rectangle& area) {
  const LogScale scale = make_scale(measurements, area);
  draw_log_grid(canvas, scale);
  const auto to_y = [&](double share) { return area.y + area.height * (1.0 - share); };
  for (const double share : {0.0, 0.25, 0.5, 0.75, 1.0}) {
    const std::array<Eigen::Vector2d, 2> line{Eigen::Vector2d(area.x, to_y(share)),
                                              Eigen::Vector2d(area.x + area.width, to_y(share))};
    canvas.line(line, kGrid, 1.0);
    canvas.text(fixed(100.0 * share, 0) + " %", {area.x - 8.0, to_y(share) + 5.0},
                {.size = 13.0, .align = TextAlign::kRight});
  }
  double legend_y = kTop + 26.0;
  std::size_t curves = 0;
  for (std::size_t i = 0; i < measurements.size(); ++i) {
    // One curve a method, or there are more than can be told apart.
    if (i > 0 && measurements[i].name == measurements[i - 1].name) continue;
    const Colour& colour = curve_colour(curves++);
    std::vector<double> sorted = measurements[i].wall.per_scan;
    std::sort(sorted.begin(), sorted.end());
    std::vector<Eigen::Vector2d> curve;
    for (std::size_t k = 0; k < sorted.size(); ++k) {
      const double share = static_cast<double>(k + 1) / static_cast<double>(sorted.size());
      curve.emplace_back(scale.to_x(sorted[k]), to_y(share));
    }
    canvas.line(curve, colour, 2.4);
    canvas.disc(curve.back(), 4.0, colour, kWhite);
    const std::string name = label_of(measurements[i]);
    const double width = canvas.text_width(name, {.size = 14.0});
    canvas.fill({area.x + 10.0, legend_y - 14.0, width + 46.0, 20.0}, {1.0, 1.0, 1.0, 0.85});
    const std::array<Eigen::Vector2d, 2> swatch{Eigen::Vector2d(area.x + 14.0, legend_y - 5.0),
                                                Eigen::Vector2d(area.x + 42.0, legend_y - 5.0)};
    canvas.line(swatch, colour, 2.6);
    canvas.text(name, {area.x + 50.0, legend_y}, {.size = 14.0});
    legend_y += 22.0;
  }
}

}  // namespace

void draw_latency(Canvas& canvas, std::span<const Measurement> measurements) {
  canvas.fill({0.0, 0.0, canvas.width(), canvas.height()}, kWhite);
  const double height = canvas.height() - kTop - kBottom;
  const double panel = 0.5 * (canvas.width() - kLabelWidth - kRight - 90.0);
  draw_stage_legend(canvas, kLabelWidth);
  draw_stages(canvas, measurements, {kLabelWidth, kTop, panel, height});
  const double right = kLabelWidth + panel + 90.0;
  canvas.text("scans that took at most so long", {right, 36.0}, {.size = 15.0});
  draw_shares(canvas, measurements, {right, kTop, panel, height});
}

}  // namespace nilio::tools
