#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "mapping/keyframe.hpp"
#include "mapping/localisation/saved_map.hpp"
#include "mapping/loops/place_checks.hpp"

namespace nilio::mapping {

/// Hypothesis of where a place lies in a map.
struct StartHypothesis {
  std::size_t place = 0;  ///< of the map, that it was compared with
  double score = 0.0;     ///< correlation of the structure on a coarse grid
  core::SE3 T_map_odom;
  CheckedAlignment checked;

  /// Geometric mean of the shares of supported structure in both directions: a few keyframes show less of the
  /// map than the map shows of them.
  [[nodiscard]] double fit() const;
  [[nodiscard]] bool passes() const { return checked.verdict == LoopVerdict::kAccepted; }
};

/// Outcome of a search in a map.
struct StartSearch {
  /// Best first.
  std::vector<StartHypothesis> hypotheses;
  /// Whether the first one passes all checks and no other one elsewhere comes near it.
  bool is_found = false;
};

/// Whether two estimates of a pose in a map with drift are not of the same pose.
bool is_apart(const core::SE3& a, const core::SE3& b);

/// Place of the last keyframes of a drive, at least two; in axes of odom about the middle one.
Place make_recent_place(std::span<const Keyframe> keyframes, double range_m);

/// Searches a place in a map without a guess. Both frames have to be aligned with gravity.
StartSearch find_start(const SavedMap& map, const Place& recent);

}  // namespace nilio::mapping
