#pragma once

#include "nilio/core/result.hpp"

#include "tools/map/cloud.hpp"
#include "tools/plot/canvas.hpp"

#include <cstdint>
#include <string>
#include <vector>

namespace nilio::tools::map {

enum class View : std::uint8_t {
  kTop,      ///< from above, x to the right
  kOblique,  ///< from the south-west, 35 degrees above the horizon
};
enum class Shading : std::uint8_t { kHeight, kIntensity };

struct RenderOptions {
  View view = View::kTop;
  Shading shading = Shading::kHeight;
  int width_px = 1600;
};

/// Picture of a map: every surface is a disc of its voxel's size in its own plane, the nearest wins, with
/// shading by the angle between its normal and the light. Orthographic; the height follows from the extent.
/// Empty without points.
plot::Raster render(const std::vector<CloudPoint>& cloud, const RenderOptions& options);

/// Renders and writes a PNG; `path` of the drive is drawn on top.
core::Result<std::string> render_png(const std::vector<CloudPoint>& cloud, const Trajectory& path,
                                     const RenderOptions& options, const std::string& file);

}  // namespace nilio::tools::map
