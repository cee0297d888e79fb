#include "tools/map/render.hpp"

#include "nilio/core/units.hpp"

#include "tools/common/statistics.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "mapping/submap.hpp"

namespace nilio::tools::map {

namespace {

using core::Matrix3;
using core::Result;
using core::Vector3;

constexpr int kMaxHeightPixels = 8000;
constexpr double kMarginShare = 0.02;
constexpr double kObliqueElevation = 35.0 * kRadiansPerDegree;
constexpr double kObliqueAzimuth = 45.0 * kRadiansPerDegree;
constexpr std::uint32_t kBackground = 0xFF101418;

/// Rows: to the right, upwards in the picture, towards the viewer.
Matrix3 axes_of(View view) {
  if (view == View::kTop) return Matrix3::Identity();
  const Vector3 towards(-std::cos(kObliqueElevation) * std::cos(kObliqueAzimuth),
                        -std::cos(kObliqueElevation) * std::sin(kObliqueAzimuth),
                        std::sin(kObliqueElevation));
  const Vector3 right = Vector3::UnitZ().cross(towards).normalized();
  Matrix3 axes;
  axes.row(0) = right;
  axes.row(1) = towards.cross(right);
  axes.row(2) = towards;
  return axes;
}

/// Colour scale from blue over green to yellow.
Vector3 colour_at(double share) {
  constexpr std::array<std::array<double, 3>, 5> stops{
      {{0.27, 0.36, 0.75}, {0.18, 0.58, 0.72}, {0.30, 0.74, 0.48}, {0.76, 0.82, 0.33}, {0.98, 0.80, 0.30}}};
  const double position = std::clamp(share, 0.0, 1.0) * (stops.size() - 1);
  const std::size_t i = std::min(static_cast<std::size_t>(position), stops.size() - 2);
  const double t = position - static_cast<double>(i);
  return (1.0 - t) * Vector3(stops[i].data()) + t * Vector3(stops[i + 1].data());
}

std::uint32_t pixel_of(const Vector3& colour) {
  const auto byte = [](double v) {
    return static_cast<std::uint32_t>(std::lround(255.0 * std::clamp(v, 0.0, 1.0)));
  };
  return 0xFF000000U | byte(colour.x()) << 16U | byte(colour.y()) << 8U | byte(colour.z());
}

/// Orthographic projection of the map onto the pixels of a picture.
struct Projection {
  Matrix3 axes;
  double left = 0.0;
  double top = 0.0;
  double pixels_per_m = 1.0;
  int width = 0;
  int height = 0;

  Projection(const std::vector<CloudPoint>& cloud, const RenderOptions& options)
      : axes(axes_of(options.view)) {
    Vector3 low = Vector3::Constant(std::numeric_limits<double>::infinity());
    Vector3 high = -low;
    for (const CloudPoint& point : cloud) {
      const Vector3 p = axes * point.position;
      low = low.cwiseMin(p);
      high = high.cwiseMax(p);
    }
    const double margin = kMarginShare * (high - low).head<2>().maxCoeff() + 1.0;
    width = options.width_px;
    pixels_per_m = width / (high.x() - low.x() + 2.0 * margin);
    const double wanted_height = pixels_per_m * (high.y() - low.y() + 2.0 * margin);
    if (wanted_height > kMaxHeightPixels) pixels_per_m *= kMaxHeightPixels / wanted_height;
    height = static_cast<int>(std::ceil(pixels_per_m * (high.y() - low.y() + 2.0 * margin)));
    left = low.x() - margin;
    top = high.y() + margin;
  }

  [[nodiscard]] Eigen::Vector2d to_pixel(const Vector3& position) const {
    const Vector3 p = axes * position;
    return {(p.x() - left) * pixels_per_m, (top - p.y()) * pixels_per_m};
  }
};

Vector3 shade(const CloudPoint& point, double share, const Matrix3& axes) {
  const Vector3 light =
      (axes.row(2).transpose() + 0.6 * axes.row(1).transpose() - 0.4 * axes.row(0).transpose()).normalized();
  const double facing = std::abs(point.normal.cast<double>().dot(light));
  return colour_at(share) * (0.45 + 0.55 * facing);
}

}  // namespace

plot::Raster render(const std::vector<CloudPoint>& cloud, const RenderOptions& options) {
  if (cloud.empty()) return {};
  const Projection projection(cloud, options);
  plot::Raster raster{projection.width, projection.height, {}};
  const auto pixels = static_cast<std::size_t>(raster.width) * static_cast<std::size_t>(raster.height);
  raster.pixels.assign(pixels, kBackground);
  std::vector<float> depth(pixels, -std::numeric_limits<float>::infinity());
  std::vector<double> values;
  values.reserve(cloud.size());
  for (const CloudPoint& point : cloud)
    values.push_back(options.shading == Shading::kHeight ? point.position.z()
                                                         : static_cast<double>(point.intensity));
  const double low = order_statistic(values, 0.02);
  const double high = std::max(order_statistic(values, 0.98), low + 0.1);
  constexpr double kRadiusMetres = 0.5 * mapping::kPlaneVoxelMetres;
  for (std::size_t k = 0; k < cloud.size(); ++k) {
    const CloudPoint& point = cloud[k];
    const Eigen::Vector2d centre = projection.to_pixel(point.position);
    const double radius = std::max(kRadiusMetres * projection.pixels_per_m, 0.5);
    const std::uint32_t colour = pixel_of(shade(point, (values[k] - low) / (high - low), projection.axes));
    const Vector3 normal = projection.axes * point.normal.cast<double>();
    const double centre_depth = projection.axes.row(2).dot(point.position);
    // Squeezed in the direction in which the disc is turned away; never thinner than a pixel.
    const double tilt = normal.head<2>().norm();
    const Eigen::Vector2d across(tilt > 1e-6 ? normal.x() / tilt : 1.0,
                                 tilt > 1e-6 ? -normal.y() / tilt : 0.0);
    const double squeezed = std::max(radius * std::abs(normal.z()), std::min(radius, 0.7));
    const auto first = [](double v) { return static_cast<int>(std::floor(v)); };
    for (int y = std::max(first(centre.y() - radius), 0);
         y <= std::min(first(centre.y() + radius), raster.height - 1); ++y) {
      for (int x = std::max(first(centre.x() - radius), 0);
           x <= std::min(first(centre.x() + radius), raster.width - 1); ++x) {
        const Eigen::Vector2d d = Eigen::Vector2d(x + 0.5, y + 0.5) - centre;
        const double a = d.dot(across) / squeezed;
        const double b = (d.x() * across.y() - d.y() * across.x()) / radius;
        const bool is_centre = first(centre.x()) == x && first(centre.y()) == y;
        if (a * a + b * b > 1.0 && !is_centre) continue;
        const auto i = static_cast<std::size_t>(y) * static_cast<std::size_t>(raster.width) +
                       static_cast<std::size_t>(x);
        if (static_cast<float>(centre_depth) <= depth[i]) continue;
        depth[i] = static_cast<float>(centre_depth);
        raster.pixels[i] = colour;
      }
    }
  }
  return raster;
}

Result<std::string> render_png(const std::vector<CloudPoint>& cloud, const Trajectory& path,
                               const RenderOptions& options, const std::string& file) {
  if (!file.ends_with(".png")) return core::Error{file + ": pictures of maps are PNG - name a .png file"};
  if (cloud.empty()) return core::Error{file + ": the map has no surfaces to draw"};
  const plot::Raster raster = render(cloud, options);
  auto canvas = plot::Canvas::create(file, raster.width, raster.height);
  if (!canvas) return canvas.error();
  canvas->raster(raster, {0.0, 0.0, static_cast<double>(raster.width), static_cast<double>(raster.height)});
  const Projection projection(cloud, options);
  std::vector<Eigen::Vector2d> line;
  line.reserve(path.poses.size());
  for (const Pose& pose : path.poses) line.push_back(projection.to_pixel(pose.translation()));
  if (!line.empty()) canvas->line(line, {0.95, 0.25, 0.25}, 2.0);
  return canvas->save();
}

}  // namespace nilio::tools::map
