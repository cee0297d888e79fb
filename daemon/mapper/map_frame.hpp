#pragma once

#include "nilio/core/se3.hpp"
#include "nilio/core/time.hpp"

#include "core/src/estimation/pose_slew_limiter.hpp"

#include <cstdint>
#include <span>
#include <utility>
#include <vector>

namespace nilio::daemon {

/// The frame `map`: poses of the submaps in it, and map -> odom, whose corrections enter gradually: the
/// published pose of the vehicle approaches the corrected one, or jumps if they are far apart. `odom` and the
/// odometry do not know of it. One thread.
class MapFrame {
 public:
  struct Placed {
    std::uint32_t id = 0;
    core::Time stamp;  ///< of the first keyframe
    core::SE3 T_odom_submap;
    core::SE3 T_map_submap;
  };

  /// Continues an earlier process.
  void restore(std::vector<Placed> submaps, const core::SE3& T_map_odom);
  /// Adds a submap; until it is corrected, it follows map -> odom.
  void add(std::uint32_t id, core::Time stamp, const core::SE3& T_odom_submap);
  /// Distance of the vehicle in `map` by a change of map -> odom.
  struct Change {
    double distance_m = 0.0;
    double angle_rad = 0.0;
    bool jumped = false;  ///< else it enters gradually
  };

  /// Takes the poses of loop closure over: ids, T_map_submap. `T_odom_base`: of the vehicle.
  Change correct(std::span<const std::pair<std::uint32_t, core::SE3>> poses, const core::SE3& T_map_odom,
                 const core::SE3& T_odom_base);
  /// Takes map -> odom over from localisation, which moves no submap: each stays where it was seen. At the
  /// `start` all of them get it, and the vehicle jumps.
  Change localise(const core::SE3& T_map_odom, const core::SE3& T_odom_base, bool start);
  /// map -> odom to publish, `since` the last call.
  const core::SE3& advance(const core::SE3& T_odom_base, core::Duration since);

  /// False while a correction enters map -> odom.
  [[nodiscard]] bool is_settled() const { return is_settled_; }
  /// map -> odom as published last.
  [[nodiscard]] const core::SE3& published() const { return published_; }
  /// In order of their ids.
  [[nodiscard]] const std::vector<Placed>& submaps() const { return submaps_; }

 private:
  Change change_to(const core::SE3& T_map_odom, const core::SE3& T_odom_base);
  /// Whether what is left of the corrections is not worth a message.
  [[nodiscard]] bool is_small() const;

  static core::PoseSlewLimiter make_limiter() {
    return core::PoseSlewLimiter({.max_slew_m_s = 0.5,
                                  .max_slew_rad_s = 0.02,
                                  .settle = core::Duration::from_seconds(1.0),
                                  .jump_m = 2.0,
                                  .jump_rad = 0.035});
  }

  std::vector<Placed> submaps_;
  core::SE3 T_map_odom_;  ///< of loop closure or localisation
  core::SE3 published_;
  core::PoseSlewLimiter limiter_ = make_limiter();
  bool is_settled_ = true;
};

}  // namespace nilio::daemon
