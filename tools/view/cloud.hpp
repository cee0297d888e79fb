#pragma once

#include "ipc/messages/messages.hpp"
#include "tools/view/frames.hpp"

#include <vector>

namespace nilio::tools::view {

/// Points of a received cloud: float32 fields x, y, z, and intensity if there is one. Empty where the message
/// contradicts itself, points that are not finite are left out.
std::vector<ViewPoint> points_of(const dds::PointCloud2& cloud);

}  // namespace nilio::tools::view
