#include "mapping/loops/loop_closure.hpp"

#include "core/src/linear_algebra.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace nilio::mapping {

namespace {

using core::Matrix6;
using core::SE3;
using core::Vector3;
using core::Vector6;

/// A revisit is at least this far along the path.
constexpr double kMinPathMetres = 60.0;
constexpr std::uint32_t kMinInliers = 10;
constexpr std::size_t kFeatureCandidates = 6;
constexpr std::size_t kGraphCandidates = 2;
// 99.9 % of 6 and of 3 degrees of freedom.
constexpr double kMaxDriftSquare = 22.46;
constexpr double kMaxTiltSquare = 16.27;
// Two loops that agree: 99 % of 6 degrees of freedom, over this path at most.
constexpr double kMaxCycleSquare = 16.81;
constexpr double kMaxCycleMetres = 500.0;

double path_after_middle(const Submap& submap) {
  double path = 0.0;
  const auto& keyframes = submap.keyframes;
  for (std::size_t i = keyframes.size() / 2 + 1; i < keyframes.size(); ++i)
    path += (keyframes[i].T_submap_base.translation - keyframes[i - 1].T_submap_base.translation).norm();
  return path;
}

/// The road goes on before the first place, whose centre is half a submap behind the start of the drive.
double max_centre_m(std::size_t reference_node) {
  return reference_node == 0 ? kMaxCentreMetres + 15.0 : kMaxCentreMetres;
}

/// Keyframe of a place before which it has seen half of its surfaces near the other one.
std::size_t middle_viewer(const Place& moving, const SE3& T_reference_moving, const Place& reference) {
  std::vector<std::size_t> near;
  for (std::size_t i = 0; i < moving.surfaces.size(); ++i) {
    const Vector3 mean = T_reference_moving * moving.surfaces[i].mean.cast<double>();
    if (is_near(reference.path, mean.cast<float>())) near.push_back(moving.viewers[i]);
  }
  if (near.empty()) return moving.path.size() / 2;
  const auto middle = near.begin() + static_cast<std::ptrdiff_t>(near.size() / 2);
  std::nth_element(near.begin(), middle, near.end());
  return *middle;
}

}  // namespace

void LoopCloser::add(const Submap& submap, const std::vector<Loop>* known) {
  Node node;
  node.id = submap.id;
  node.T_odom_submap = submap.T_odom_submap;
  node.T_submap_place = place_origin(submap);
  const SE3 T_odom_place = node.T_odom_submap * node.T_submap_place;
  if (!nodes_.empty()) {
    OdometryEdge edge;
    edge.T_from_to = odometry_.back().inverse() * T_odom_place;
    edge.path_m = std::max(path_after_middle(recent_.back()), edge.T_from_to.translation.norm());
    node.path_m = nodes_.back().path_m + edge.path_m;
    poses_.push_back(poses_.back() * edge.T_from_to * core::se3_exp(-bias_jacobian(edge) * biases_));
    edges_.push_back(edge);
  } else {
    poses_.push_back(T_odom_place);
  }
  nodes_.push_back(std::move(node));
  odometry_.push_back(T_odom_place);
  recent_.push_back(submap);
  if (recent_.size() > 3) recent_.pop_front();
  if (nodes_.size() < 2) return;
  const std::size_t middle = nodes_.size() - 2;
  std::vector<const Submap*> around;
  for (const Submap& neighbour : recent_) around.push_back(&neighbour);
  const Place place = make_place(around, around.size() - 2);
  nodes_[middle].features = place.features;
  if (searched_ > middle) return;
  if (known == nullptr) {
    search(middle, place, false);
    return;
  }
  const std::size_t before = loops_.size();
  bool more_follow = false;
  for (const Loop& loop : *known) {
    const std::size_t reference = index_of(loop.reference);
    if (loop.moving == place.id && reference < middle && nodes_[reference].id == loop.reference)
      loops_.push_back(loop);
    more_follow |= loop.moving > place.id;
  }
  searched_ = middle + 1;
  if (loops_.size() != before && !more_follow) solve();
}

void LoopCloser::finish() {
  if (nodes_.empty() || searched_ == nodes_.size()) return;
  std::vector<const Submap*> around;
  for (const Submap& neighbour : recent_) around.push_back(&neighbour);
  if (around.size() > 2) around.erase(around.begin());
  const Place place = make_place(around, around.size() - 1);
  nodes_.back().features = place.features;
  search(nodes_.size() - 1, place, true);
}

std::vector<LoopCloser::Candidate> LoopCloser::candidates(std::size_t node) const {
  std::vector<Candidate> found;
  std::vector<Candidate> predicted;
  for (std::size_t i = 0; i < node; ++i) {
    if (nodes_[node].path_m - nodes_[i].path_m < kMinPathMetres) continue;
    for (const PlanarAlignment& guess : align_features(nodes_[i].features, nodes_[node].features, 2)) {
      if (guess.inliers >= kMinInliers) found.push_back({i, guess});
    }
    const SE3 T = poses_[i].inverse() * poses_[node];
    if (T.translation.norm() < max_centre_m(i)) predicted.push_back({i, {T, 0}});
  }
  std::stable_sort(found.begin(), found.end(),
                   [](const Candidate& a, const Candidate& b) { return a.guess.inliers > b.guess.inliers; });
  if (found.size() > kFeatureCandidates) found.resize(kFeatureCandidates);
  const auto distance = [](const Candidate& c) { return c.guess.T_reference_moving.translation.norm(); };
  std::stable_sort(predicted.begin(), predicted.end(),
                   [&](const Candidate& a, const Candidate& b) { return distance(a) < distance(b); });
  std::size_t taken = 0;
  for (const Candidate& candidate : predicted) {
    const bool is_known = std::any_of(found.begin(), found.end(), [&](const Candidate& other) {
      return other.node == candidate.node &&
             !is_elsewhere(other.guess.T_reference_moving, candidate.guess.T_reference_moving);
    });
    if (!is_known && taken++ < kGraphCandidates) found.push_back(candidate);
  }
  return found;
}

std::optional<Place> LoopCloser::load_place(std::size_t node) const {
  std::vector<Submap> submaps;
  std::size_t middle = 0;
  for (std::size_t i = node > 0 ? node - 1 : 0; i <= std::min(node + 1, nodes_.size() - 1); ++i) {
    auto submap = load_(nodes_[i].id);
    if (!submap) return std::nullopt;
    if (i == node) middle = submaps.size();
    submaps.push_back(std::move(*submap));
  }
  std::vector<const Submap*> pointers;
  for (const Submap& submap : submaps) pointers.push_back(&submap);
  return make_place(pointers, middle);
}

Loop LoopCloser::verify(const Place& reference, const Candidate& candidate, const ComparablePlace& moving,
                        std::size_t moving_node) const {
  Loop loop;
  loop.reference = reference.id;
  loop.moving = moving.place().id;
  loop.inliers = candidate.guess.inliers;
  const auto refuse = [&](LoopVerdict verdict) {
    loop.verdict = verdict;
    return loop;
  };
  const auto guess = with_height(candidate.guess.T_reference_moving, reference, moving.place());
  if (!guess || guess->translation.head<2>().norm() > max_centre_m(candidate.node))
    return refuse(LoopVerdict::kFar);
  // Of the graph, whose earlier loops tell the biases of the odometry.
  std::vector<OdometryEdge> edges;
  for (std::size_t i = candidate.node; i < moving_node; ++i)
    edges.push_back({poses_[i].inverse() * poses_[i + 1], edges_[i].path_m});
  Vector6 coarse;
  coarse << 4.0, 4.0, 1.0, 0.01, 0.01, 0.01;  // of a guess
  loop.drift_square = chain_distance(edges, *guess, coarse.asDiagonal());
  loop.alignment.T_reference_moving = *guess;
  if (loop.drift_square > kMaxDriftSquare) return refuse(LoopVerdict::kDrift);

  const CheckedAlignment checked = check_alignment(ComparablePlace(reference), moving, *guess,
                                                   {.max_centre_m = max_centre_m(candidate.node)});
  loop.alignment = checked.alignment;
  loop.support_share = checked.support_share;
  loop.ambiguity = checked.ambiguity;
  if (checked.verdict != LoopVerdict::kAccepted) return refuse(checked.verdict);
  const PlaceAlignment& alignment = loop.alignment;
  const SE3& T = alignment.T_reference_moving;
  const Matrix6 covariance = core::inverse_ldlt(alignment.information);
  loop.drift_square = chain_distance(edges, T, covariance);
  if (loop.drift_square > kMaxDriftSquare) return refuse(LoopVerdict::kDrift);
  // Height, roll and pitch alone: they drift little.
  const Chain drift = chain(edges);
  const core::Matrix3 vertical = (drift.covariance() + covariance).block<3, 3>(2, 2);
  const Vector3 tilt = core::se3_log(T.inverse() * drift.T_from_to).segment<3>(2);
  if (tilt.dot(Eigen::LDLT<core::Matrix3>(vertical).solve(tilt)) > kMaxTiltSquare)
    return refuse(LoopVerdict::kTilt);
  return loop;
}

/// Registers both halves of the moving place on their own, of as many surfaces near the reference. They share
/// no surface.
bool LoopCloser::halves_agree(const Loop& loop, const Place& moving) const {
  const std::optional<Place> reference = load_place(index_of(loop.reference));
  if (!reference) return false;
  const ComparablePlace comparable(*reference);
  const std::size_t split = middle_viewer(moving, loop.alignment.T_reference_moving, *reference);
  std::array<PlaceAlignment, 2> alignments;
  for (const std::size_t half : {0U, 1U}) {
    Place part;
    part.path = moving.path;
    for (std::size_t i = 0; i < moving.surfaces.size(); ++i) {
      if ((moving.viewers[i] < split) != (half == 0)) continue;
      part.surfaces.push_back(moving.surfaces[i]);
      part.viewers.push_back(moving.viewers[i]);
    }
    alignments[half] = align_places(comparable, ComparablePlace(part), loop.alignment.T_reference_moving);
    alignments[half].information = with_common_errors(alignments[half].information);
  }
  const Vector6 error =
      core::se3_log(alignments[0].T_reference_moving.inverse() * alignments[1].T_reference_moving);
  const Matrix6 covariance =
      core::inverse_ldlt(alignments[0].information) + core::inverse_ldlt(alignments[1].information);
  return error.dot(core::solve_ldlt(covariance, error)) < kMaxCycleSquare &&
         unobserved_directions(alignments[0].information) +
                 unobserved_directions(alignments[1].information) ==
             0;
}

void LoopCloser::search(std::size_t node, const Place& place, bool is_end) {
  searched_ = node + 1;
  const std::size_t first = loops_.size();
  const ComparablePlace comparable(place);
  for (const Candidate& candidate : candidates(node)) {
    const std::optional<Place> reference = load_place(candidate.node);
    if (reference) loops_.push_back(verify(*reference, candidate, comparable, node));
  }
  // The same two places in two ways: neither is to be trusted. The same way twice counts once.
  for (std::size_t i = first; i < loops_.size(); ++i) {
    for (std::size_t j = loops_.size() - 1; j > i; --j) {
      if (!loops_[i].is_verified() || !loops_[j].is_verified() || loops_[i].reference != loops_[j].reference)
        continue;
      if (is_elsewhere(loops_[i].alignment.T_reference_moving, loops_[j].alignment.T_reference_moving))
        loops_[i].verdict = loops_[j].verdict = LoopVerdict::kAmbiguous;
      else
        loops_.erase(loops_.begin() + static_cast<std::ptrdiff_t>(j));
    }
  }
  bool is_changed = false;
  for (std::size_t i = first; i < loops_.size(); ++i) {
    if (!loops_[i].is_verified()) continue;
    is_changed = true;
    loops_[i].is_twofold = is_end && halves_agree(loops_[i], place);
  }
  if (is_changed) solve();
}

void LoopCloser::set_positions(std::span<const MeasuredPosition> positions) {
  positions_.assign(positions.begin(), positions.end());
  std::erase_if(positions_, [&](const MeasuredPosition& position) {
    const std::size_t node = index_of(static_cast<std::uint32_t>(position.node));
    return node == nodes_.size() || nodes_[node].id != position.node;
  });
  if (!positions_.empty()) solve();
}

std::size_t LoopCloser::index_of(std::uint32_t id) const {
  const auto found =
      std::lower_bound(nodes_.begin(), nodes_.end(), id,
                       [](const Node& node, std::uint32_t wanted) { return node.id < wanted; });
  return static_cast<std::size_t>(found - nodes_.begin());
}

void LoopCloser::solve() {
  std::vector<std::size_t> verified;
  std::vector<LoopEdge> all;
  for (std::size_t i = 0; i < loops_.size(); ++i) {
    const Loop& loop = loops_[i];
    if (!loop.is_verified()) continue;
    verified.push_back(i);
    all.push_back({index_of(loop.reference), index_of(loop.moving), loop.alignment.T_reference_moving,
                   loop.alignment.information});
  }
  const auto path_between = [&](std::size_t a, std::size_t b) {
    return std::abs(nodes_[a].path_m - nodes_[b].path_m);
  };
  std::vector<bool> is_supported;
  for (const std::size_t i : verified) is_supported.push_back(loops_[i].is_twofold);
  for (std::size_t i = 0; i < all.size(); ++i) {
    for (std::size_t j = i + 1; j < all.size(); ++j) {
      if (path_between(all[i].reference, all[j].reference) + path_between(all[i].moving, all[j].moving) >
          kMaxCycleMetres)
        continue;
      if (cycle_error(all[i], all[j], edges_) > kMaxCycleSquare) continue;
      is_supported[i] = is_supported[j] = true;
    }
  }
  std::vector<LoopEdge> edges;
  std::vector<std::size_t> used;
  for (std::size_t i = 0; i < all.size(); ++i) {
    loops_[verified[i]].verdict = LoopVerdict::kAlone;
    if (!is_supported[i]) continue;
    edges.push_back(all[i]);
    used.push_back(verified[i]);
  }
  std::vector<MeasuredPosition> positions = positions_;
  for (MeasuredPosition& position : positions)
    position.node = index_of(static_cast<std::uint32_t>(position.node));
  const GraphSolution solution = optimise(odometry_, edges_, edges, positions);
  for (std::size_t i = 0; i < positions_.size(); ++i)
    positions_[i].is_inlier = solution.is_position_inlier[i];
  T_measured_map_ = solution.T_measured_map;
  for (std::size_t i = 0; i < used.size(); ++i)
    loops_[used[i]].verdict = solution.is_inlier[i] ? LoopVerdict::kAccepted : LoopVerdict::kInconsistent;
  poses_ = solution.poses;
  biases_ = solution.biases;
}

std::vector<std::pair<std::uint32_t, SE3>> LoopCloser::poses() const {
  std::vector<std::pair<std::uint32_t, SE3>> result;
  for (std::size_t i = 0; i < nodes_.size(); ++i)
    result.emplace_back(nodes_[i].id, poses_[i] * nodes_[i].T_submap_place.inverse());
  return result;
}

SE3 LoopCloser::T_map_odom() const {
  return nodes_.empty() ? SE3{} : poses_.back() * odometry_.back().inverse();
}

std::size_t LoopCloser::accepted() const {
  return static_cast<std::size_t>(std::count_if(
      loops_.begin(), loops_.end(), [](const Loop& loop) { return loop.verdict == LoopVerdict::kAccepted; }));
}

}  // namespace nilio::mapping
