#pragma once

#include "nilio/core/result.hpp"

#include <cstddef>
#include <functional>
#include <optional>
#include <utility>
#include <vector>

#include "mapping/localisation/place_image.hpp"
#include "mapping/loops/place.hpp"
#include "mapping/map_folder.hpp"

namespace nilio::mapping {

/// A map to localise in: its submaps as places, whose images are in memory (20 kB each); their surfaces are
/// loaded when they are needed. The files are only read. One thread.
class SavedMap {
 public:
  /// Submap of an entry; empty if it cannot be read: it is left out.
  using Load = std::function<std::optional<Submap>(const SubmapEntry&)>;
  SavedMap(std::vector<SubmapEntry> entries, Load load)
      : entries_(std::move(entries)), load_(std::move(load)) {}

  /// Computes the image of the next place. False if all are known.
  bool prepare_next();
  /// Places whose images are known.
  [[nodiscard]] std::size_t size() const { return places_.size(); }
  [[nodiscard]] const PlaceImage& image(std::size_t place) const { return places_[place].image; }
  /// Pose of a place in the frame of the map.
  [[nodiscard]] const core::SE3& T_map_place(std::size_t place) const { return places_[place].T_map_place; }
  /// Id of the submap that a place belongs to.
  [[nodiscard]] std::uint32_t id(std::size_t place) const { return entries_[place].id; }
  /// Whether no place could be read.
  [[nodiscard]] bool is_empty() const;
  /// The whole place; empty if a submap cannot be read.
  [[nodiscard]] std::optional<Place> load_place(std::size_t place) const;
  /// Surfaces within a horizontal distance of a position, relative to it, in axes of the map.
  [[nodiscard]] std::vector<Surface> surfaces_near(const core::Vector3& position, double radius_m) const;

 private:
  struct Node {
    core::SE3 T_map_place;
    PlaceImage image;
    bool is_read = false;
  };

  std::vector<SubmapEntry> entries_;
  Load load_;
  std::vector<Node> places_;
};

}  // namespace nilio::mapping
