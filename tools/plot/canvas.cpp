#include "tools/plot/canvas.hpp"

#include "tools/common/files.hpp"

#include <array>
#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <numbers>

namespace nilio::tools::plot {

namespace {

constexpr double kSmallestStep = 1.0 / 3.0;

[[gnu::format(printf, 2, 3)]] void append(std::string& text, const char* format, ...) {
  std::array<char, 512> line{};
  va_list arguments;
  va_start(arguments, format);
  std::vsnprintf(line.data(), line.size(), format, arguments);
  va_end(arguments);
  text += line.data();
}

/// Value of an SVG paint attribute, and its opacity.
std::string svg_paint(const char* attribute, const Colour& c) {
  const auto byte = [](double value) { return static_cast<int>(std::lround(255.0 * value)); };
  std::string text;
  append(text, "%s=\"#%02x%02x%02x\"", attribute, byte(c.red), byte(c.green), byte(c.blue));
  if (c.alpha < 1.0) append(text, " %s-opacity=\"%.2f\"", attribute, c.alpha);
  return text;
}

std::string escaped(const std::string& text) {
  std::string result;
  for (const char c : text) {
    if (c == '&') {
      result += "&amp;";
    } else if (c == '<') {
      result += "&lt;";
    } else {
      result += c;
    }
  }
  return result;
}

std::string base64(const std::string& bytes) {
  static constexpr const char* kDigits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    std::uint32_t group = 0;
    for (std::size_t k = 0; k < 3; ++k)
      group = group << 8U | (i + k < bytes.size() ? static_cast<unsigned char>(bytes[i + k]) : 0U);
    for (std::size_t k = 0; k < 4; ++k)
      text += i + k > bytes.size() ? '=' : kDigits[group >> (18U - 6U * static_cast<unsigned>(k)) & 63U];
  }
  return text;
}

void set_colour(cairo_t* context, const Colour& c) {
  cairo_set_source_rgba(context, c.red, c.green, c.blue, c.alpha);
}

cairo_status_t append_bytes(void* closure, const unsigned char* data, unsigned int length) {
  static_cast<std::string*>(closure)->append(reinterpret_cast<const char*>(data), length);
  return CAIRO_STATUS_SUCCESS;
}

}  // namespace

core::Result<Canvas> Canvas::create(const std::string& path, int width, int height) {
  Canvas canvas;
  canvas.path_ = path;
  canvas.is_svg_ = path.ends_with(".svg");
  if (!canvas.is_svg_ && !path.ends_with(".png"))
    return core::Error{path + ": the extension has to be .png or .svg"};
  canvas.width_ = width;
  canvas.height_ = height;
  // SVG needs cairo only for the width of texts.
  canvas.surface_.reset(cairo_image_surface_create(CAIRO_FORMAT_ARGB32, canvas.is_svg_ ? 1 : width,
                                                   canvas.is_svg_ ? 1 : height));
  canvas.context_.reset(cairo_create(canvas.surface_.get()));
  const cairo_status_t status = cairo_status(canvas.context_.get());
  if (status != CAIRO_STATUS_SUCCESS) return core::Error{path + ": " + cairo_status_to_string(status)};
  cairo_set_line_join(canvas.context_.get(), CAIRO_LINE_JOIN_ROUND);
  cairo_set_line_cap(canvas.context_.get(), CAIRO_LINE_CAP_ROUND);
  return canvas;
}

void Canvas::fill(const Rectangle& area, const Colour& colour) {
  if (is_svg_) {
    append(svg_, "<rect x=\"%.1f\" y=\"%.1f\" width=\"%.1f\" height=\"%.1f\" %s/>\n", area.x, area.y,
           area.width, area.height, svg_paint("fill", colour).c_str());
    return;
  }
  set_colour(context_.get(), colour);
  cairo_rectangle(context_.get(), area.x, area.y, area.width, area.height);
  cairo_fill(context_.get());
}

void Canvas::line(std::span<const Eigen::Vector2d> points, const Colour& colour, double line_width) {
  if (points.empty()) return;
  if (is_svg_) {
    append(svg_, "<polyline fill=\"none\" stroke-linejoin=\"round\" %s stroke-width=\"%.1f\" points=\"",
           svg_paint("stroke", colour).c_str(), line_width);
  } else {
    set_colour(context_.get(), colour);
    cairo_set_line_width(context_.get(), line_width);
    cairo_new_path(context_.get());
  }
  Eigen::Vector2d last = points.front();
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector2d& p = points[i];
    if (i > 0 && i + 1 < points.size() && (p - last).norm() < kSmallestStep) continue;
    last = p;
    is_svg_ ? append(svg_, "%.1f,%.1f ", p.x(), p.y()) : cairo_line_to(context_.get(), p.x(), p.y());
  }
  is_svg_ ? append(svg_, "\"/>\n") : cairo_stroke(context_.get());
}

void Canvas::disc(const Eigen::Vector2d& centre, double radius, const Colour& colour, const Colour& edge) {
  constexpr double edge_width = 1.5;
  if (is_svg_) {
    append(svg_, "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"%.1f\" %s %s stroke-width=\"%.1f\"/>\n", centre.x(),
           centre.y(), radius, svg_paint("fill", colour).c_str(), svg_paint("stroke", edge).c_str(),
           edge_width);
    return;
  }
  cairo_new_path(context_.get());
  cairo_arc(context_.get(), centre.x(), centre.y(), radius, 0.0, 2.0 * std::numbers::pi);
  set_colour(context_.get(), colour);
  cairo_fill_preserve(context_.get());
  set_colour(context_.get(), edge);
  cairo_set_line_width(context_.get(), edge_width);
  cairo_stroke(context_.get());
}

Canvas::Surface Canvas::make_surface(const Raster& raster) {
  Surface image(cairo_image_surface_create(CAIRO_FORMAT_ARGB32, raster.width, raster.height));
  unsigned char* const data = cairo_image_surface_get_data(image.get());
  if (data == nullptr) return image;
  const int stride = cairo_image_surface_get_stride(image.get());
  const std::size_t row_bytes = static_cast<std::size_t>(raster.width) * sizeof(std::uint32_t);
  for (int row = 0; row < raster.height; ++row) {
    std::memcpy(data + static_cast<std::ptrdiff_t>(row) * stride,
                raster.pixels.data() + static_cast<std::ptrdiff_t>(row) * raster.width, row_bytes);
  }
  cairo_surface_mark_dirty(image.get());
  return image;
}

void Canvas::raster(const Raster& raster, const Rectangle& area) {
  const Surface image = make_surface(raster);
  if (is_svg_) {
    std::string png;
    cairo_surface_write_to_png_stream(image.get(), append_bytes, &png);
    append(svg_, "<image x=\"%.1f\" y=\"%.1f\" width=\"%.1f\" height=\"%.1f\" href=\"data:image/png;base64,",
           area.x, area.y, area.width, area.height);
    svg_ += base64(png) + "\"/>\n";
    return;
  }
  cairo_save(context_.get());
  cairo_translate(context_.get(), area.x, area.y);
  cairo_scale(context_.get(), area.width / raster.width, area.height / raster.height);
  cairo_set_source_surface(context_.get(), image.get(), 0.0, 0.0);
  cairo_paint(context_.get());
  cairo_restore(context_.get());
}

double Canvas::text_width(const std::string& text, const TextStyle& style) {
  cairo_select_font_face(context_.get(), "sans-serif", CAIRO_FONT_SLANT_NORMAL,
                         style.bold ? CAIRO_FONT_WEIGHT_BOLD : CAIRO_FONT_WEIGHT_NORMAL);
  cairo_set_font_size(context_.get(), style.size);
  cairo_text_extents_t extents;
  cairo_text_extents(context_.get(), text.c_str(), &extents);
  return extents.x_advance;
}

void Canvas::text(const std::string& text, const Eigen::Vector2d& at, const TextStyle& style) {
  static constexpr std::array<const char*, 3> kAnchors{"start", "middle", "end"};
  const auto align = static_cast<std::size_t>(style.align);
  if (is_svg_) {
    append(svg_, "<text transform=\"translate(%.1f %.1f)%s\" font-family=\"sans-serif\" font-size=\"%.0f\"",
           at.x(), at.y(), style.vertical ? " rotate(-90)" : "", style.size);
    append(svg_, "%s text-anchor=\"%s\" %s>", style.bold ? " font-weight=\"bold\"" : "", kAnchors[align],
           svg_paint("fill", style.colour).c_str());
    svg_ += escaped(text) + "</text>\n";
    return;
  }
  const double shift = -0.5 * static_cast<double>(align) * text_width(text, style);
  cairo_save(context_.get());
  cairo_translate(context_.get(), at.x(), at.y());
  if (style.vertical) cairo_rotate(context_.get(), -0.5 * std::numbers::pi);
  cairo_move_to(context_.get(), shift, 0.0);
  set_colour(context_.get(), style.colour);
  cairo_show_text(context_.get(), text.c_str());
  cairo_new_path(context_.get());
  cairo_restore(context_.get());
}

void Canvas::clip(const Rectangle& area) {
  if (is_svg_) {
    append(svg_,
           "<clipPath id=\"clip%d\"><rect x=\"%.1f\" y=\"%.1f\" width=\"%.1f\" height=\"%.1f\"/></clipPath>\n"
           "<g clip-path=\"url(#clip%d)\">\n",
           clips_, area.x, area.y, area.width, area.height, clips_);
    ++clips_;
    return;
  }
  cairo_save(context_.get());
  cairo_rectangle(context_.get(), area.x, area.y, area.width, area.height);
  cairo_clip(context_.get());
}

void Canvas::unclip() { is_svg_ ? append(svg_, "</g>\n") : cairo_restore(context_.get()); }

core::Result<std::string> Canvas::save() {
  bool good = false;
  if (is_svg_) {
    std::ofstream file(path_, std::ios::binary);
    std::string head;
    append(head,
           "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"%.0f\" height=\"%.0f\" "
           "viewBox=\"0 0 %.0f %.0f\">\n",
           width_, height_, width_, height_);
    file << head << svg_ << "</svg>\n";
    good = static_cast<bool>(file.flush());
  } else {
    good = cairo_surface_write_to_png(surface_.get(), path_.c_str()) == CAIRO_STATUS_SUCCESS;
  }
  if (good) return path_;
  return cannot_write(path_);
}

}  // namespace nilio::tools::plot
