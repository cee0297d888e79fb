#pragma once

#include "nilio/core/se3.hpp"
#include "nilio/core/time.hpp"

#include <cstddef>
#include <deque>
#include <optional>
#include <string>

#include "mapping/localisation/global_start.hpp"
#include "mapping/localisation/map_tracker.hpp"

namespace nilio::mapping {

enum class LocalisationState {
  kSearching,  ///< where the vehicle is in the map is not known
  kLocalised,  ///< the registration against the map corrects the pose
  kOutside,    ///< the map does not show the surroundings: odometry only, from the last correction
  kElsewhere,  ///< the drive does not continue the run of the map: no more searches
};
/// Name in logs and reports.
const char* name_of(LocalisationState state);

/// Result of a keyframe.
struct Localisation {
  core::Time stamp;
  LocalisationState state = LocalisationState::kSearching;
  core::SE3 T_map_odom;  ///< unless searching
  /// See MapMatch.
  core::Matrix6 covariance = core::Matrix6::Identity();
  double supported = 0.0;
  /// Change of state with this keyframe, for people; empty: none.
  std::string event;
  /// Reason for which the last search has no answer.
  std::string refusal = "no data yet";
};

/// Localises a drive in a saved map: searches without a guess from the last 40 m, until two in a row agree,
/// then tracking. Where the map does not show the surroundings, the last correction is held, and the search
/// begins again. Results depend on the keyframes and the map only. One thread.
class Localiser {
 public:
  /// `map` outlives this and has to be prepared. `last_pose`: T_map_base at the end of a run that was killed,
  /// which the drive may continue; without an answer in its first 100 m, it does not.
  Localiser(const SavedMap& map, double range_m, std::optional<core::SE3> last_pose = std::nullopt)
      : map_(map), range_m_(range_m), last_pose_(last_pose), tracker_(map) {}

  Localisation add(const Keyframe& keyframe);

 private:
  [[nodiscard]] bool is_search_due() const;
  void search(const Keyframe& keyframe);

  const SavedMap& map_;
  double range_m_;
  std::optional<core::SE3> last_pose_;
  MapTracker tracker_;
  std::deque<Keyframe> recent_;
  double path_m_ = 0.0;         ///< since the last search
  double searched_m_ = 0.0;     ///< of the drive
  double recent_path_m_ = 0.0;  ///< of the recent keyframes
  std::size_t since_search_ = 0;
  std::size_t unsupported_ = 0;  ///< keyframes in a row
  /// T_map_odom that the last search has found; the next one has to agree.
  std::optional<core::SE3> found_;
  Localisation state_;
};

}  // namespace nilio::mapping
