#pragma once

#include "nilio/core/result.hpp"

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>
#include <cairo/cairo.h>

namespace nilio::tools {

/// 0..1.
struct Colour {
  double red = 0.0;
  double green = 0.0;
  double blue = 0.0;
  double alpha = 1.0;
};

inline constexpr Colour kWhite{1.0, 1.0, 1.0};
inline constexpr Colour kPaper{0.985, 0.985, 0.985};  ///< inside a chart's axes
inline constexpr Colour kGrid{0.86, 0.86, 0.86};

/// Pixels, y down.
struct Rectangle {
  double x = 0.0;
  double y = 0.0;
  double width = 0.0;
  double height = 0.0;
};

enum class TextAlign { kLeft, kCentre, kRight };

struct TextStyle {
  double size = 14.0;
  Colour colour{0.2, 0.2, 0.2};
  TextAlign align = TextAlign::kLeft;
  bool bold = false;
  /// Reads upwards.
  bool vertical = false;
};

/// Opaque or transparent pixels for a part of a picture, top row first.
struct Raster {
  int width = 0;
  int height = 0;
  /// 0xAARRGGBB, colours multiplied by alpha.
  std::vector<std::uint32_t> pixels;
};

/// A picture being drawn, in pixels of its size.
class Canvas {
 public:
  /// The extension decides between PNG and SVG; any other is an error.
  static core::Result<Canvas> create(const std::string& path, int width, int height);

  [[nodiscard]] double width() const { return width_; }
  [[nodiscard]] double height() const { return height_; }

  void fill(const Rectangle& area, const Colour& colour);
  void frame(const Rectangle& area, const Colour& colour, double line_width);
  void line(std::span<const Eigen::Vector2d> points, const Colour& colour, double line_width);
  void disc(const Eigen::Vector2d& centre, double radius, const Colour& colour, const Colour& edge);
  void raster(const Raster& raster, const Rectangle& area);
  void text(const std::string& text, const Eigen::Vector2d& at, const TextStyle& style);
  [[nodiscard]] double text_width(const std::string& text, const TextStyle& style);
  /// Drawing until the next unclip() stays inside `area`.
  void clip(const Rectangle& area);
  void unclip();
  /// Writes the file; the canvas cannot be drawn on any more.
  core::Result<std::string> save();

 private:
  struct SurfaceDeleter {
    void operator()(cairo_surface_t* surface) const { cairo_surface_destroy(surface); }
  };
  struct ContextDeleter {
    void operator()(cairo_t* context) const { cairo_destroy(context); }
  };

  Canvas() = default;
  void set_colour(const Colour& colour);
  void set_font(const TextStyle& style);

  std::string path_;
  bool is_svg_ = false;
  double width_ = 0.0;
  double height_ = 0.0;
  std::unique_ptr<cairo_surface_t, SurfaceDeleter> surface_;
  std::unique_ptr<cairo_t, ContextDeleter> context_;
};

/// Data coordinates on a part of the canvas.
struct Axes {
  Rectangle area;
  double x_min = 0.0;
  double x_max = 1.0;
  double y_min = 0.0;
  double y_max = 1.0;

  [[nodiscard]] Eigen::Vector2d to_pixel(const Eigen::Vector2d& point) const;
  [[nodiscard]] double pixels_per_x() const { return area.width / (x_max - x_min); }
};

/// 1, 2 or 5 times a power of ten: the smallest that divides `range` into at most `max_parts`.
double nice_step(double range, int max_parts);

/// Grid, frame, numbers and labels around the area.
void draw_axes(Canvas& canvas, const Axes& axes, const std::string& x_label, const std::string& y_label);

}  // namespace nilio::tools
