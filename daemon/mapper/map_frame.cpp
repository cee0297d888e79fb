#include "daemon/mapper/map_frame.hpp"

namespace nilio::daemon {
namespace {

// Corrections below this wait for more.
constexpr double kSettledMetres = 0.001;
constexpr double kSettledRadians = 0.0001;

}  // namespace

void MapFrame::restore(std::vector<Placed> submaps, const core::SE3& T_map_odom) {
  submaps_ = std::move(submaps);
  T_map_odom_ = published_ = T_map_odom;
}

void MapFrame::add(std::uint32_t id, core::Time stamp, const core::SE3& T_odom_submap) {
  submaps_.push_back({id, stamp, T_odom_submap, T_map_odom_ * T_odom_submap});
}

MapFrame::Change MapFrame::correct(std::span<const std::pair<std::uint32_t, core::SE3>> poses,
                                   const core::SE3& T_map_odom, const core::SE3& T_odom_base) {
  auto corrected = poses.begin();
  for (Placed& submap : submaps_) {
    while (corrected != poses.end() && corrected->first < submap.id) ++corrected;
    const bool is_corrected = corrected != poses.end() && corrected->first == submap.id;
    submap.T_map_submap = is_corrected ? corrected->second : T_map_odom * submap.T_odom_submap;
  }
  return change_to(T_map_odom, T_odom_base);
}

MapFrame::Change MapFrame::localise(const core::SE3& T_map_odom, const core::SE3& T_odom_base, bool start) {
  if (!start) return change_to(T_map_odom, T_odom_base);
  for (Placed& submap : submaps_) submap.T_map_submap = T_map_odom * submap.T_odom_submap;
  T_map_odom_ = published_ = T_map_odom;
  limiter_ = make_limiter();
  is_settled_ = true;
  return {0.0, 0.0, true};
}

MapFrame::Change MapFrame::change_to(const core::SE3& T_map_odom, const core::SE3& T_odom_base) {
  const core::SE3 before = T_map_odom_ * T_odom_base;
  const core::SE3 after = T_map_odom * T_odom_base;
  T_map_odom_ = T_map_odom;
  const bool jumped = limiter_.correct(before, after).jumped;
  is_settled_ = !jumped && is_small();
  return {(after.translation - before.translation).norm(), before.rotation.angularDistance(after.rotation),
          jumped};
}

bool MapFrame::is_small() const {
  return limiter_.translation_left().norm() < kSettledMetres &&
         limiter_.rotation_left().norm() < kSettledRadians;
}

const core::SE3& MapFrame::advance(const core::SE3& T_odom_base, core::Duration since) {
  const core::SE3 T_map_base = limiter_.smooth(T_map_odom_ * T_odom_base, since);
  is_settled_ = is_small();
  published_ = is_settled_ ? T_map_odom_ : T_map_base * T_odom_base.inverse();
  return published_;
}

}  // namespace nilio::daemon
