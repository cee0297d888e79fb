#include "mapping/localisation/global_start.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "mapping/submap_builder.hpp"

namespace nilio::mapping {

namespace {

using core::SE3;

constexpr std::size_t kCandidates = 24;
// An equal place has an equal score, less where the map shows a part of it only.
constexpr double kMinCandidateScoreShare = 0.55;
// Neighbouring places show the same; storeys are 2.5 m apart at least.
constexpr double kOtherPlaceMetres = 3.0;
constexpr double kOtherPlaceCosine = 0.985;  // 10 degrees
// Two estimates of one pose in a map with drift.
constexpr double kSamePlaceMetres = 1.5;
constexpr double kSamePlaceCosine = 0.9986;  // 3 degrees
// Vertical axes of two frames, one of them levelled at a moving start by an accelerometer, which braking or a
// turn of 2 m/s^2 tilts by 12 degrees.
constexpr double kMinVerticalCosine = 0.978;
// The world changes between two visits, unlike within a drive. Other shifts are rivals of their own here.
constexpr CheckLimits kLimits{.max_centre_m = 35.0,
                              .min_support_share = 0.45,
                              .max_contradiction = 0.2,
                              .max_ambiguity = 1.0,
                              .registered_surfaces = 600};
// A place that differs in every fifth object from the map has 0.8 of the fit of an unchanged one.
constexpr double kMinFit = 0.78;
// A hypothesis elsewhere with more of the best one's fit makes it ambiguous. So does one with this support in
// one direction, however well the best one fits: nothing is wrong with it, the map shows a part only of what
// the vehicle sees there.
constexpr double kMaxRivalFit = 0.8;
constexpr double kMaxRivalSupport = 0.9;
// A hypothesis that fits worse and has this much more of its structure in free space is refuted.
constexpr double kRefutingContradiction = 0.03;

struct Candidate {
  std::size_t place = 0;
  PlaceTemplate::Match match;
  SE3 T_map_recent;
};

/// Whether two poses differ; height counts double.
bool is_apart(const SE3& a, const SE3& b, double metres, double cosine) {
  const SE3 d = a.inverse() * b;
  const double w = d.rotation.w();
  return (b.translation - a.translation).cwiseProduct(core::Vector3(1.0, 1.0, 2.0)).norm() > metres ||
         2.0 * w * w - 1.0 < cosine;
}

/// Where the structure resembles that of the map, best first; once for each pose.
std::vector<Candidate> candidates_of(const SavedMap& map, const Place& recent) {
  const PlaceTemplate wanted(recent);
  std::vector<Candidate> all;
  for (std::size_t i = 0; i < map.size(); ++i) {
    for (const PlaceTemplate::Match& match : wanted.find_in(map.image(i)))
      all.push_back({i, match, map.T_map_place(i) * match.T_image_template});
  }
  std::stable_sort(all.begin(), all.end(),
                   [](const Candidate& a, const Candidate& b) { return a.match.score > b.match.score; });
  std::vector<Candidate> found;
  for (const Candidate& candidate : all) {
    if (candidate.match.score < kMinCandidateScoreShare * all.front().match.score) break;
    const bool is_new = std::all_of(found.begin(), found.end(), [&](const Candidate& other) {
      return is_apart(candidate.T_map_recent, other.T_map_recent, kOtherPlaceMetres, kOtherPlaceCosine);
    });
    if (is_new) found.push_back(candidate);
  }
  return found;
}

bool is_upright(const SE3& T) { return (T.rotation * core::Vector3::UnitZ()).z() > kMinVerticalCosine; }

StartHypothesis verify(const std::optional<ComparablePlace>& reference, const ComparablePlace& recent,
                       const Candidate& candidate) {
  StartHypothesis hypothesis;
  hypothesis.place = candidate.place;
  hypothesis.score = candidate.match.score;
  hypothesis.checked.verdict = LoopVerdict::kFar;
  const auto guess = reference
                         ? with_height(candidate.match.T_image_template, reference->place(), recent.place())
                         : std::nullopt;
  if (!guess) return hypothesis;
  hypothesis.checked = check_alignment(*reference, recent, *guess, kLimits);
  const SE3& T = hypothesis.checked.alignment.T_reference_moving;
  if (hypothesis.passes() && hypothesis.fit() < kMinFit) hypothesis.checked.verdict = LoopVerdict::kSupport;
  if (hypothesis.passes() && !is_upright(T)) hypothesis.checked.verdict = LoopVerdict::kTilt;
  hypothesis.T_map_odom = reference->place().T_odom_place * T * recent.place().T_odom_place.inverse();
  return hypothesis;
}

/// Whether nothing tells which of two hypotheses is wrong.
bool is_rival(const StartHypothesis& other, const StartHypothesis& best) {
  if (other.fit() > kMaxRivalFit * best.fit()) return true;
  if (other.checked.alignment.contradiction > best.checked.alignment.contradiction + kRefutingContradiction)
    return false;
  return other.passes() || other.checked.larger_support_share >
                               kMaxRivalSupport * std::min(1.0, best.checked.larger_support_share);
}

bool is_better(const StartHypothesis& a, const StartHypothesis& b) {
  return a.passes() != b.passes() ? a.passes() : a.fit() > b.fit();
}

}  // namespace

double StartHypothesis::fit() const {
  return std::sqrt(checked.support_share * checked.larger_support_share);
}

bool is_apart(const SE3& a, const SE3& b) { return is_apart(a, b, kSamePlaceMetres, kSamePlaceCosine); }

Place make_recent_place(std::span<const Keyframe> keyframes, double range_m) {
  // One submap takes them all.
  SubmapConfig config;
  config.length_m = config.duration_s = 1e9;
  config.range_m = range_m;
  SubmapBuilder builder(config, [](const Submap&) {});
  for (const Keyframe& keyframe : keyframes) builder.add(keyframe);
  const std::optional<Submap> submap = builder.local_map();
  if (!submap) return {};
  const std::array<const Submap*, 1> only{&*submap};
  return make_place(only, 0);
}

StartSearch find_start(const SavedMap& map, const Place& recent) {
  std::vector<Candidate> candidates = candidates_of(map, recent);
  StartSearch search;
  if (candidates.size() > kCandidates) candidates.resize(kCandidates);
  // Each place is loaded once.
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const Candidate& a, const Candidate& b) { return a.place < b.place; });
  const ComparablePlace comparable(recent);
  std::optional<Place> place;
  std::optional<ComparablePlace> reference;
  for (std::size_t i = 0; i < candidates.size(); ++i) {
    if (i == 0 || candidates[i].place != candidates[i - 1].place) {
      reference.reset();
      place = map.load_place(candidates[i].place);
      if (place) reference.emplace(*place);
    }
    search.hypotheses.push_back(verify(reference, comparable, candidates[i]));
  }
  std::stable_sort(search.hypotheses.begin(), search.hypotheses.end(), is_better);
  if (search.hypotheses.empty() || !search.hypotheses.front().passes()) return search;
  const StartHypothesis& best = search.hypotheses.front();
  search.is_found =
      std::none_of(search.hypotheses.begin() + 1, search.hypotheses.end(), [&](const StartHypothesis& other) {
        return is_rival(other, best) &&
               is_apart(best.T_map_odom * recent.T_odom_place, other.T_map_odom * recent.T_odom_place);
      });
  return search;
}

}  // namespace nilio::mapping
