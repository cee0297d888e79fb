#pragma once

#include "nilio/core/result.hpp"

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>
#include <cairo/cairo.h>

namespace nilio::tools::plot {

/// Components 0..1.
struct Colour {
  double red = 0.0;
  double green = 0.0;
  double blue = 0.0;
  double alpha = 1.0;
};

inline constexpr Colour kWhite{1.0, 1.0, 1.0};

/// Pixels, y down.
struct Rectangle {
  double x = 0.0;
  double y = 0.0;
  double width = 0.0;
  double height = 0.0;

  [[nodiscard]] double right() const { return x + width; }
  [[nodiscard]] double bottom() const { return y + height; }
};

enum class TextAlign { kLeft, kCentre, kRight };

struct TextStyle {
  double size = 14.0;
  Colour colour{0.2, 0.2, 0.2};
  TextAlign align = TextAlign::kLeft;
  bool bold = false;
  bool vertical = false;  ///< reads upwards
};

/// Pixels of a part of a picture, top row first.
struct Raster {
  int width = 0;
  int height = 0;
  std::vector<std::uint32_t> pixels;  ///< 0xAARRGGBB, colours multiplied by alpha
};

/// A PNG or SVG picture while it is drawn; coordinates are its pixels. SVG text remains text. Not
/// thread-safe.
class Canvas {
 public:
  /// The extension of `path` selects PNG or SVG; any other is an error.
  static core::Result<Canvas> create(const std::string& path, int width, int height);

  [[nodiscard]] double width() const { return width_; }
  [[nodiscard]] double height() const { return height_; }

  void fill(const Rectangle& area, const Colour& colour);
  /// Points closer than a third of a pixel to the previous one are left out.
  void line(std::span<const Eigen::Vector2d> points, const Colour& colour, double line_width);
  void disc(const Eigen::Vector2d& centre, double radius, const Colour& colour, const Colour& edge);
  void raster(const Raster& raster, const Rectangle& area);
  /// `at` is on the base line.
  void text(const std::string& text, const Eigen::Vector2d& at, const TextStyle& style);
  /// In SVG an estimate: the viewer chooses the font.
  [[nodiscard]] double text_width(const std::string& text, const TextStyle& style);
  /// Limits drawing to `area` until unclip().
  void clip(const Rectangle& area);
  void unclip();
  /// Writes the file. Fails when it cannot be written; nothing may be drawn afterwards.
  core::Result<std::string> save();

 private:
  struct SurfaceDeleter {
    void operator()(cairo_surface_t* surface) const { cairo_surface_destroy(surface); }
  };
  struct ContextDeleter {
    void operator()(cairo_t* context) const { cairo_destroy(context); }
  };
  using Surface = std::unique_ptr<cairo_surface_t, SurfaceDeleter>;

  Canvas() = default;
  static Surface make_surface(const Raster& raster);

  std::string path_;
  double width_ = 0.0;
  double height_ = 0.0;
  bool is_svg_ = false;
  std::string svg_;  ///< elements so far
  int clips_ = 0;
  Surface surface_;
  std::unique_ptr<cairo_t, ContextDeleter> context_;
};

}  // namespace nilio::tools::plot
