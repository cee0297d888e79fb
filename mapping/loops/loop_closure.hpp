#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "mapping/loops/place_checks.hpp"
#include "mapping/loops/pose_graph.hpp"

namespace nilio::mapping {

/// Candidate of a loop between two places. Transforms are between places, see place_origin().
struct Loop {
  std::uint32_t reference = 0;  ///< id of the earlier submap
  std::uint32_t moving = 0;     ///< id of the later submap
  PlaceAlignment alignment;
  std::uint32_t inliers = 0;   ///< features that agree; 0: the guess is that of the pose graph
  double drift_square = 0.0;   ///< squared Mahalanobis distance from the pose graph, 6 degrees of freedom
  double support_share = 0.0;  ///< alignment.support over what the places support themselves
  double ambiguity = 0.0;
  /// Whether both halves of the last place of a drive give this loop: they count as two.
  bool is_twofold = false;
  LoopVerdict verdict = LoopVerdict::kAlone;

  /// Whether all checks of the loop alone are passed.
  [[nodiscard]] bool is_verified() const {
    return verdict == LoopVerdict::kAccepted || verdict == LoopVerdict::kAlone ||
           verdict == LoopVerdict::kInconsistent;
  }
};

/// Finds places that a drive returns to and keeps the poses of its submaps consistent with them. Submaps are
/// added in order; the result depends on nothing else. Keeps 25 kB for each submap and loads the others again
/// to compare with them. One thread.
class LoopCloser {
 public:
  /// Submap with this id, which has been added before; empty if it cannot be read: its place is left out.
  using Load = std::function<std::optional<Submap>(std::uint32_t)>;
  explicit LoopCloser(Load load) : load_(std::move(load)) {}

  /// Adds a submap and searches loops for the one before it, whose neighbours are then known. `known`: all
  /// loops of an earlier process, of which those of that submap are taken in place of a search; poses follow
  /// with the last of them.
  void add(const Submap& submap, const std::vector<Loop>* known = nullptr);
  /// Searches loops for the last submap. More submaps may follow.
  void finish();
  /// Adds measured positions of points in axes of the places, see place_origin(), and moves the submaps to
  /// agree with them; their nodes are ids of submaps.
  void set_positions(std::span<const MeasuredPosition> positions);

  /// Ids and T_map_submap of all submaps in the order of adding.
  [[nodiscard]] std::vector<std::pair<std::uint32_t, core::SE3>> poses() const;
  /// T_map_odom: correction at the last submap.
  [[nodiscard]] core::SE3 T_map_odom() const;
  [[nodiscard]] const std::vector<Loop>& loops() const { return loops_; }
  [[nodiscard]] std::size_t accepted() const;
  [[nodiscard]] const std::vector<MeasuredPosition>& positions() const { return positions_; }
  [[nodiscard]] const core::SE3& T_measured_map() const { return T_measured_map_; }
  /// Odometry from the place of each submap to the next.
  [[nodiscard]] std::span<const OdometryEdge> edges() const { return edges_; }

 private:
  struct Node {
    std::uint32_t id = 0;
    core::SE3 T_odom_submap;
    core::SE3 T_submap_place;
    double path_m = 0.0;  ///< along the drive, at the place
    std::vector<PlaceFeature> features;
  };
  struct Candidate {
    std::size_t node = 0;
    PlanarAlignment guess;
  };

  [[nodiscard]] std::optional<Place> load_place(std::size_t node) const;
  [[nodiscard]] std::vector<Candidate> candidates(std::size_t node) const;
  [[nodiscard]] Loop verify(const Place& reference, const Candidate& candidate, const ComparablePlace& moving,
                            std::size_t moving_node) const;
  [[nodiscard]] bool halves_agree(const Loop& loop, const Place& moving) const;
  void search(std::size_t node, const Place& place, bool is_end);
  void solve();
  [[nodiscard]] std::size_t index_of(std::uint32_t id) const;

  Load load_;
  std::vector<Node> nodes_;
  std::vector<core::SE3> odometry_;  ///< of the places
  std::vector<core::SE3> poses_;     ///< of the places, corrected
  std::vector<OdometryEdge> edges_;
  Eigen::Vector3d biases_ = Eigen::Vector3d::Zero();  ///< of the odometry
  std::vector<Loop> loops_;
  std::vector<MeasuredPosition> positions_;
  core::SE3 T_measured_map_;
  std::deque<Submap> recent_;  ///< the last three
  std::size_t searched_ = 0;   ///< nodes whose loops are known
};

}  // namespace nilio::mapping
