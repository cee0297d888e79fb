#include "mapping/localisation/saved_map.hpp"

#include <algorithm>

namespace nilio::mapping {

using core::SE3;
using core::Vector3;

bool SavedMap::prepare_next() {
  const std::size_t next = places_.size();
  if (next >= entries_.size()) return false;
  Node node;
  if (const std::optional<Place> place = load_place(next)) {
    node.T_map_place = place->T_odom_place;
    node.image = PlaceImage(*place);
    node.is_read = true;
  }
  places_.push_back(std::move(node));
  return true;
}

bool SavedMap::is_empty() const {
  return std::all_of(places_.begin(), places_.end(), [](const Node& node) { return !node.is_read; });
}

std::optional<Place> SavedMap::load_place(std::size_t place) const {
  std::vector<Submap> submaps;
  std::size_t middle = 0;
  for (std::size_t i = place > 0 ? place - 1 : 0; i <= std::min(place + 1, entries_.size() - 1); ++i) {
    auto submap = load_(entries_[i]);
    if (!submap) {
      if (i == place) return std::nullopt;
      continue;
    }
    if (i == place) middle = submaps.size();
    // Its axes are those of the map from here on.
    submap->T_odom_submap = entries_[i].T_map_submap;
    submaps.push_back(std::move(*submap));
  }
  std::vector<const Submap*> pointers;
  for (const Submap& submap : submaps) pointers.push_back(&submap);
  return make_place(pointers, middle);
}

std::vector<Surface> SavedMap::surfaces_near(const Vector3& position, double radius_m) const {
  std::vector<Surface> surfaces;
  for (const SubmapEntry& entry : entries_) {
    const Vector3 p = entry.T_map_submap.inverse() * position;
    const Vector3 low = entry.minimum.cast<double>();
    const Vector3 high = entry.maximum.cast<double>();
    const Vector3 outside = (low - p).cwiseMax(p - high).cwiseMax(0.0);
    if (outside.head<2>().norm() > radius_m) continue;
    const std::optional<Submap> submap = load_(entry);
    if (!submap) continue;
    SE3 T = entry.T_map_submap;
    T.translation -= position;
    const Eigen::Matrix3f R = T.rotation.toRotationMatrix().cast<float>();
    const Eigen::Vector3f t = T.translation.cast<float>();
    const auto radius = static_cast<float>(radius_m);
    for (Surface surface : submap->surfaces) {
      surface.mean = R * surface.mean + t;
      surface.normal = R * surface.normal;
      if (surface.mean.head<2>().squaredNorm() < radius * radius) surfaces.push_back(surface);
    }
  }
  return surfaces;
}

}  // namespace nilio::mapping
