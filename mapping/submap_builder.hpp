#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "mapping/keyframe.hpp"
#include "mapping/submap.hpp"
#include "mapping/surface_grid.hpp"

namespace nilio::mapping {

struct SubmapConfig {
  double length_m = 50.0;            ///< a submap is closed after this path,
  double duration_s = 25.0;          ///< or after this time in motion
  double range_m = 50.0;             ///< points farther from their sensor are left out
  std::size_t max_voxels = 200'000;  ///< of an open submap
};

/// Cuts a drive into submaps that overlap by half, and accumulates their surfaces. A drive consists of
/// stretches of half a submap; submap i covers the stretches i and i + 1, and is complete when submap i + 1
/// is, because a voxel that both have seen is stored where it has more points. Open at any time: at
/// most three submaps. One thread.
class SubmapBuilder {
 public:
  /// Called with each complete submap, in order of their ids.
  using Complete = std::function<void(const Submap&)>;

  /// `first_id`: of the first submap. `already_stored`: of the submap before it, if there is one.
  SubmapBuilder(const SubmapConfig& config, Complete complete, std::uint32_t first_id = 0);

  /// Surfaces of a submap before the first one, which are not stored again; from a file. Call it for the last
  /// kNeighbours, as far as there are.
  void continue_after(const Submap& previous);
  /// Submaps before one that may have seen the same voxels, at the longest range.
  static constexpr std::size_t kNeighbours = 4;
  /// Adds a keyframe, in order of time. Returns the number of the stretch it belongs to.
  std::uint32_t add(const Keyframe& keyframe);
  /// Completes all open submaps. The next keyframe begins a new one.
  void finish();

  /// Submaps that are complete, or will be with the keyframes so far.
  [[nodiscard]] std::uint32_t next_id() const { return first_open_; }
  /// The newest open submap with at least half of its length, as it is; empty before the first keyframe.
  [[nodiscard]] std::optional<Submap> local_map() const;
  /// Points left out because an open submap had its maximum of voxels.
  [[nodiscard]] std::uint64_t refused() const { return refused_; }

 private:
  struct Open {
    Submap submap;
    std::unique_ptr<SurfaceGrid> grid;
    Eigen::Vector3i origin_voxel;  ///< of the grid in odom
  };

  void begin_stretch(const core::SE3& T_odom_base);
  void add_to(Open& open, const Keyframe& keyframe) const;
  void complete_oldest();
  void divide(Open& oldest, Open& successor) const;
  [[nodiscard]] static Submap freeze(const Open& open);

  SubmapConfig config_;
  Complete complete_;
  std::vector<Open> open_;  ///< oldest first
  std::uint32_t first_open_;
  std::uint32_t stretch_;  ///< current one; that of the next keyframe if `stretch_is_over_`
  bool stretch_is_over_ = true;
  double stretch_m_ = 0.0;
  double stretch_s_ = 0.0;
  std::optional<core::SE3> T_odom_last_;
  core::Time last_stamp_;
  /// Plane voxels of the stored submaps before the first one, by their index in odom.
  std::vector<Eigen::Vector3i> stored_;
  std::uint64_t refused_ = 0;
};

}  // namespace nilio::mapping
