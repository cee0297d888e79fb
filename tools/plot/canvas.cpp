#include "tools/plot/canvas.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstring>

#include <cairo/cairo-svg.h>

namespace nilio::tools {

namespace {

constexpr Colour kGridColour{0.0, 0.0, 0.0, 0.10};
constexpr Colour kFrameColour{0.45, 0.45, 0.45};

std::string format_tick(double value, double step) {
  const int digits = std::clamp(static_cast<int>(std::ceil(-std::log10(step) - 1e-9)), 0, 9);
  std::array<char, 64> text{};
  // Adding zero turns -0 into 0.
  std::snprintf(text.data(), text.size(), "%.*f", digits, std::round(value / step) * step + 0.0);
  return text.data();
}

}  // namespace

core::Result<Canvas> Canvas::create(const std::string& path, int width, int height) {
  Canvas canvas;
  canvas.path_ = path;
  canvas.is_svg_ = path.ends_with(".svg");
  if (!canvas.is_svg_ && !path.ends_with(".png")) {
    return core::Error{path + ": the extension has to be .png or .svg"};
  }
  canvas.width_ = width;
  canvas.height_ = height;
  canvas.surface_.reset(canvas.is_svg_ ? cairo_svg_surface_create(path.c_str(), width, height)
                                       : cairo_image_surface_create(CAIRO_FORMAT_ARGB32, width, height));
  canvas.context_.reset(cairo_create(canvas.surface_.get()));
  const cairo_status_t status = cairo_status(canvas.context_.get());
  if (status != CAIRO_STATUS_SUCCESS) return core::Error{path + ": " + cairo_status_to_string(status)};
  cairo_set_line_join(canvas.context_.get(), CAIRO_LINE_JOIN_ROUND);
  cairo_set_line_cap(canvas.context_.get(), CAIRO_LINE_CAP_ROUND);
  return canvas;
}

void Canvas::set_colour(const Colour& c) {
  cairo_set_source_rgba(context_.get(), c.red, c.green, c.blue, c.alpha);
}

void Canvas::set_font(const TextStyle& style) {
  cairo_select_font_face(context_.get(), "sans-serif", CAIRO_FONT_SLANT_NORMAL,
                         style.bold ? CAIRO_FONT_WEIGHT_BOLD : CAIRO_FONT_WEIGHT_NORMAL);
  cairo_set_font_size(context_.get(), style.size);
}

void Canvas::fill(const Rectangle& area, const Colour& colour) {
  set_colour(colour);
  cairo_rectangle(context_.get(), area.x, area.y, area.width, area.height);
  cairo_fill(context_.get());
}

void Canvas::frame(const Rectangle& area, const Colour& colour, double line_width) {
  set_colour(colour);
  cairo_set_line_width(context_.get(), line_width);
  cairo_rectangle(context_.get(), area.x, area.y, area.width, area.height);
  cairo_stroke(context_.get());
}

void Canvas::line(std::span<const Eigen::Vector2d> points, const Colour& colour, double line_width) {
  if (points.empty()) return;
  set_colour(colour);
  cairo_set_line_width(context_.get(), line_width);
  cairo_move_to(context_.get(), points[0].x(), points[0].y());
  for (const Eigen::Vector2d& point : points.subspan(1)) cairo_line_to(context_.get(), point.x(), point.y());
  cairo_stroke(context_.get());
}

void Canvas::disc(const Eigen::Vector2d& centre, double radius, const Colour& colour, const Colour& edge) {
  constexpr double full_circle_rad = 6.283185307179586;
  cairo_new_path(context_.get());
  cairo_arc(context_.get(), centre.x(), centre.y(), radius, 0.0, full_circle_rad);
  set_colour(colour);
  cairo_fill_preserve(context_.get());
  set_colour(edge);
  cairo_set_line_width(context_.get(), 1.5);
  cairo_stroke(context_.get());
}

void Canvas::raster(const Raster& raster, const Rectangle& area) {
  using Surface = std::unique_ptr<cairo_surface_t, SurfaceDeleter>;
  const Surface image(cairo_image_surface_create(CAIRO_FORMAT_ARGB32, raster.width, raster.height));
  unsigned char* data = cairo_image_surface_get_data(image.get());
  if (data == nullptr) return;
  cairo_surface_flush(image.get());
  const int stride = cairo_image_surface_get_stride(image.get());
  const std::size_t row_bytes = static_cast<std::size_t>(raster.width) * sizeof(std::uint32_t);
  for (int row = 0; row < raster.height; ++row) {
    std::memcpy(data + static_cast<std::ptrdiff_t>(row) * stride,
                raster.pixels.data() + static_cast<std::ptrdiff_t>(row) * raster.width, row_bytes);
  }
  cairo_surface_mark_dirty(image.get());
  cairo_save(context_.get());
  cairo_translate(context_.get(), area.x, area.y);
  cairo_scale(context_.get(), area.width / raster.width, area.height / raster.height);
  cairo_set_source_surface(context_.get(), image.get(), 0.0, 0.0);
  cairo_paint(context_.get());
  cairo_restore(context_.get());
}

double Canvas::text_width(const std::string& text, const TextStyle& style) {
  set_font(style);
  cairo_text_extents_t extents;
  cairo_text_extents(context_.get(), text.c_str(), &extents);
  return extents.x_advance;
}

void Canvas::text(const std::string& text, const Eigen::Vector2d& at, const TextStyle& style) {
  const double width = text_width(text, style);
  double shift = 0.0;
  if (style.align == TextAlign::kCentre) shift = -0.5 * width;
  if (style.align == TextAlign::kRight) shift = -width;
  cairo_save(context_.get());
  cairo_translate(context_.get(), at.x(), at.y());
  if (style.vertical) cairo_rotate(context_.get(), -1.5707963267948966);
  cairo_move_to(context_.get(), shift, 0.0);
  set_colour(style.colour);
  cairo_show_text(context_.get(), text.c_str());
  cairo_restore(context_.get());
}

void Canvas::clip(const Rectangle& area) {
  cairo_save(context_.get());
  cairo_rectangle(context_.get(), area.x, area.y, area.width, area.height);
  cairo_clip(context_.get());
}

void Canvas::unclip() { cairo_restore(context_.get()); }

core::Result<std::string> Canvas::save() {
  cairo_status_t status = cairo_status(context_.get());
  if (status == CAIRO_STATUS_SUCCESS && is_svg_) {
    cairo_surface_finish(surface_.get());
    status = cairo_surface_status(surface_.get());
  } else if (status == CAIRO_STATUS_SUCCESS) {
    status = cairo_surface_write_to_png(surface_.get(), path_.c_str());
  }
  if (status == CAIRO_STATUS_SUCCESS) return path_;
  return core::Error{path_ + ": " + cairo_status_to_string(status) +
                     "; check the folder and the space on the disk"};
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

void draw_axes(Canvas& canvas, const Axes& axes, const std::string& x_label, const std::string& y_label) {
  const Rectangle& area = axes.area;
  const double bottom = area.y + area.height;
  const double x_step = nice_step(axes.x_max - axes.x_min, std::max(2, static_cast<int>(area.width / 80.0)));
  const double y_step = nice_step(axes.y_max - axes.y_min, std::max(2, static_cast<int>(area.height / 42.0)));
  for (double x = std::ceil(axes.x_min / x_step) * x_step; x <= axes.x_max + 1e-9 * x_step; x += x_step) {
    const double px = axes.to_pixel({x, axes.y_min}).x();
    const std::array<Eigen::Vector2d, 2> grid{Eigen::Vector2d(px, area.y), Eigen::Vector2d(px, bottom)};
    canvas.line(grid, kGridColour, 1.0);
    canvas.text(format_tick(x, x_step), {px, bottom + 18.0}, {.size = 13.0, .align = TextAlign::kCentre});
  }
  double widest = 0.0;
  for (double y = std::ceil(axes.y_min / y_step) * y_step; y <= axes.y_max + 1e-9 * y_step; y += y_step) {
    const double py = axes.to_pixel({axes.x_min, y}).y();
    const std::array<Eigen::Vector2d, 2> grid{Eigen::Vector2d(area.x, py),
                                              Eigen::Vector2d(area.x + area.width, py)};
    canvas.line(grid, kGridColour, 1.0);
    const TextStyle style{.size = 13.0, .align = TextAlign::kRight};
    canvas.text(format_tick(y, y_step), {area.x - 7.0, py + 4.5}, style);
    widest = std::max(widest, canvas.text_width(format_tick(y, y_step), style));
  }
  canvas.frame(area, kFrameColour, 1.0);
  canvas.text(x_label, {area.x + 0.5 * area.width, bottom + 40.0},
              {.size = 15.0, .align = TextAlign::kCentre});
  canvas.text(y_label, {area.x - widest - 18.0, area.y + 0.5 * area.height},
              {.size = 15.0, .align = TextAlign::kCentre, .vertical = true});
}

}  // namespace nilio::tools
