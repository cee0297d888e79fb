#include "mapping/localisation/localiser.hpp"

#include "nilio/core/units.hpp"

#include "core/src/linear_algebra.hpp"

#include <array>
#include <cstdio>
#include <utility>
#include <vector>

namespace nilio::mapping {

namespace {

using core::SE3;

// Part of the drive that is searched.
constexpr double kRecentMetres = 40.0;
constexpr std::size_t kMaxRecent = 120;
// A search needs surfaces that several keyframes have seen.
constexpr std::size_t kMinKeyframes = 5;
// While more of the surroundings appears with each metre, and later.
constexpr double kFirstStepMetres = 2.0;
constexpr double kStepMetres = 10.0;
// A run that was killed continues within this path, or not at all.
constexpr double kContinuedMetres = 100.0;
// Keyframes in a row without support after which the map does not show the surroundings.
constexpr std::size_t kMaxUnsupported = 10;

std::string described(const SavedMap& map, const StartHypothesis& found) {
  std::string text(160, '\0');
  const core::Vector3& t = found.T_map_odom.translation;
  const int length = std::snprintf(
      text.data(), text.size(),
      "localised near submap %u: score %.2f, overlap %.2f, fit %.2f; odom at %.1f %.1f %.1f m",
      map.id(found.place), found.score, found.checked.alignment.overlap, found.fit(), t.x(), t.y(), t.z());
  text.resize(static_cast<std::size_t>(length));
  return text;
}

std::string from_last_pose(const SE3& moved) {
  std::array<char, 80> text{};
  std::snprintf(text.data(), text.size(), "; %.1f m, %.1f deg from the last pose of the earlier run",
                moved.translation.norm(), core::so3_log(moved.rotation).norm() * kDegreesPerRadian);
  return text.data();
}

}  // namespace

const char* name_of(LocalisationState state) {
  switch (state) {
    case LocalisationState::kLocalised:
      return "localised";
    case LocalisationState::kOutside:
      return "odometry only";
    case LocalisationState::kElsewhere:
      return "elsewhere";
    case LocalisationState::kSearching:
      break;
  }
  return "searching";
}

bool Localiser::is_search_due() const {
  if (recent_.size() < kMinKeyframes || since_search_ == 0) return false;
  return path_m_ >= (recent_path_m_ < kRecentMetres ? kFirstStepMetres : kStepMetres);
}

Localisation Localiser::add(const Keyframe& keyframe) {
  const auto distance = [](const Keyframe& a, const Keyframe& b) {
    return (a.T_odom_base.translation - b.T_odom_base.translation).norm();
  };
  if (!recent_.empty()) {
    const double step = distance(recent_.back(), keyframe);
    path_m_ += step;
    searched_m_ += step;
    recent_path_m_ += step;
  }
  recent_.push_back(keyframe);
  while (recent_.size() > kMaxRecent || (recent_path_m_ > kRecentMetres && recent_.size() > kMinKeyframes)) {
    recent_path_m_ -= distance(recent_[0], recent_[1]);
    recent_.pop_front();
  }
  ++since_search_;
  state_.stamp = keyframe.stamp;
  state_.event.clear();
  if (state_.state == LocalisationState::kLocalised) {
    const MapMatch match = tracker_.add(keyframe);
    state_.covariance = match.covariance;
    state_.supported = match.supported;
    state_.T_map_odom = match.T_map_base * keyframe.T_odom_base.inverse();
    unsupported_ = match.is_used ? 0 : unsupported_ + 1;
    if (unsupported_ >= kMaxUnsupported) {
      state_.state = LocalisationState::kOutside;
      state_.event = "the map does not show the surroundings: odometry only";
    }
  } else if (state_.state != LocalisationState::kElsewhere && is_search_due()) {
    search(keyframe);
  }
  return state_;
}

void Localiser::search(const Keyframe& keyframe) {
  path_m_ = 0.0;
  since_search_ = 0;
  const std::vector<Keyframe> keyframes(recent_.begin(), recent_.end());
  const Place place = make_recent_place(keyframes, range_m_);
  const StartSearch search = find_start(map_, place);
  const std::optional<SE3> before = std::exchange(found_, std::nullopt);
  if (!search.is_found) {
    if (state_.state == LocalisationState::kSearching && last_pose_ && searched_m_ > kContinuedMetres)
      state_.state = LocalisationState::kElsewhere;
    state_.refusal = search.hypotheses.empty()            ? "nothing in the map is similar"
                     : search.hypotheses.front().passes() ? "several places fit"
                                                          : "the best place fails the check: ";
    if (!search.hypotheses.empty() && !search.hypotheses.front().passes())
      state_.refusal += verdict_name(search.hypotheses.front().checked.verdict);
    return;
  }
  const StartHypothesis& found = search.hypotheses.front();
  if (!before || is_apart(*before * keyframe.T_odom_base, found.T_map_odom * keyframe.T_odom_base)) {
    found_ = found.T_map_odom;
    state_.refusal = "no second search agrees yet";
    return;
  }
  state_.state = LocalisationState::kLocalised;
  state_.event = described(map_, found);
  if (last_pose_)
    state_.event += from_last_pose(last_pose_->inverse() * found.T_map_odom * keyframe.T_odom_base);
  unsupported_ = 0;
  const SE3 T_map_base = found.T_map_odom * keyframe.T_odom_base;
  // From the place to the vehicle.
  const core::Matrix6 turned = core::adjoint(keyframe.T_odom_base.inverse() * place.T_odom_place);
  state_.covariance = turned * core::inverse_ldlt(found.checked.alignment.information) * turned.transpose();
  tracker_.start(T_map_base, keyframe.T_odom_base, state_.covariance);
  const MapMatch match = tracker_.add(keyframe);
  state_.covariance = match.covariance;
  state_.supported = match.supported;
  state_.T_map_odom = match.T_map_base * keyframe.T_odom_base.inverse();
}

}  // namespace nilio::mapping
