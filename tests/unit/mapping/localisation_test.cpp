#include "tests/support/lookalikes.hpp"

#include <algorithm>
#include <map>
#include <optional>
#include <random>
#include <string>

#include <catch2/catch.hpp>

#include "mapping/localisation/localiser.hpp"
#include "mapping/submap_builder.hpp"

namespace {

using namespace nilio;
using namespace nilio::mapping;
using namespace nilio::tests;

// Drawn once.
constexpr std::uint32_t kSeed = 3298301173U;
// A search takes seconds with AddressSanitizer: fewer places then.
#if defined(__SANITIZE_ADDRESS__)
constexpr std::size_t kStride = 4;
#else
constexpr std::size_t kStride = 1;
#endif
const std::vector<PathPoint> kAroundTheBlock{{{0, 0}},  {{120, 0}}, {{120, 80}},
                                             {{0, 80}}, {{0, 0}},   {{60, 0}}};

/// Map of a drive whose odometry is right, in memory.
struct MapOfDrive {
  explicit MapOfDrive(const ScannedDrive& drive)
      : submaps(),
        map(entries_of(drive), [this](const SubmapEntry& e) { return std::optional(submaps[e.id]); }) {
    while (map.prepare_next()) {
    }
  }

  std::vector<SubmapEntry> entries_of(const ScannedDrive& drive) {
    SubmapBuilder builder({}, [&](const Submap& submap) { submaps.push_back(submap); });
    for (const Keyframe& keyframe : drive.keyframes) builder.add(keyframe);
    builder.finish();
    std::vector<SubmapEntry> entries;
    for (const Submap& submap : submaps) {
      SubmapEntry entry;
      entry.id = submap.id;
      entry.T_odom_submap = entry.T_map_submap = submap.T_odom_submap;
      entry.minimum = submap.minimum;
      entry.maximum = submap.maximum;
      entries.push_back(entry);
    }
    return entries;
  }

  std::vector<Submap> submaps;
  SavedMap map;
};

/// The world at another time: every tenth box stands elsewhere.
ScannedWorld changed(ScannedWorld world) {
  for (std::size_t box = 0; box + 4 <= world.walls.size(); box += 40) {
    for (std::size_t i = box; i < box + 4; ++i) {
      world.walls[i].a += Vector2d(3.0, 1.5);
      world.walls[i].b += Vector2d(3.0, 1.5);
    }
  }
  return world;
}

struct Answer {
  std::size_t keyframes = 0;  ///< until the first answer
  double error_m = 0.0;
  double angle_rad = 0.0;
};

/// Error of the vehicle in the map, which has the frame of the truth.
Answer answer_of(const Localisation& result, const core::SE3& T_odom_base, const core::SE3& truth,
                 std::size_t keyframes) {
  const core::SE3 error = truth.inverse() * result.T_map_odom * T_odom_base;
  return {keyframes, error.translation.norm(), core::so3_log(error.rotation).norm()};
}

/// A drive from a keyframe on, with odometry that begins there, heading along x.
Keyframe keyframe_of(const ScannedDrive& drive, std::size_t first, std::size_t i) {
  Keyframe keyframe = drive.keyframes[i];
  keyframe.T_odom_base = drive.keyframes[first].T_odom_base.inverse() * keyframe.T_odom_base;
  return keyframe;
}

/// First answer, if there is one.
std::optional<Answer> localise(const SavedMap& map, const ScannedDrive& drive, std::size_t first,
                               std::size_t count) {
  Localiser localiser(map, 50.0);
  for (std::size_t i = first; i < std::min(first + count, drive.keyframes.size()); ++i) {
    const Keyframe keyframe = keyframe_of(drive, first, i);
    const Localisation result = localiser.add(keyframe);
    if (result.state == LocalisationState::kLocalised)
      return answer_of(result, keyframe.T_odom_base, drive.truth[i], i - first + 1);
  }
  return std::nullopt;
}

/// The block, and its map.
struct MappedBlock {
  ScannedWorld world = block(kSeed);
  MapOfDrive map{drive(world, kAroundTheBlock, {}, kSeed)};
};
const MappedBlock& mapped_block() {
  static const MappedBlock mapped;
  return mapped;
}

struct Count {
  std::size_t right = 0;
  std::size_t wrong = 0;
  std::size_t none = 0;
};

/// Answers from places along a drive through a map of the same world.
Count count_answers(const std::string& name, const Lookalike& lookalike, std::uint32_t seed, std::size_t step,
                    std::size_t count) {
  const MapOfDrive map(drive(lookalike.world, lookalike.path, {}, seed));
  const ScannedDrive later = drive(lookalike.world, lookalike.path, {}, seed + 1);
  Count answers;
  for (std::size_t first = 0; first + count / 2 < later.keyframes.size(); first += step) {
    const auto answer = localise(map.map, later, first, count);
    if (!answer) {
      ++answers.none;
      continue;
    }
    const bool is_right = answer->error_m < 0.5 && answer->angle_rad < 0.035;
    ++(is_right ? answers.right : answers.wrong);
    if (!is_right)
      UNSCOPED_INFO(name << ", seed " << seed << ", from keyframe " << first << ": " << answer->error_m
                         << " m after " << answer->keyframes << " keyframes");
  }
  return answers;
}

}  // namespace

TEST_CASE(
    "a drive finds itself in a map of the same streets, in both directions, although a tenth has changed",
    "[localisation]") {
  Count answers;
  for (const bool is_reverse : {false, true}) {
    std::vector<PathPoint> path = kAroundTheBlock;
    if (is_reverse) std::reverse(path.begin(), path.end());
    const ScannedDrive later = drive(changed(mapped_block().world), path, {}, kSeed + 1);
    for (std::size_t first = 0; first + 20 < later.keyframes.size(); first += 160 * kStride) {
      const auto answer = localise(mapped_block().map.map, later, first, 20);
      if (!answer) {
        ++answers.none;
        continue;
      }
      const bool is_right = answer->error_m < 0.3 && answer->angle_rad < 0.02;
      ++(is_right ? answers.right : answers.wrong);
    }
  }
  INFO("right " << answers.right << ", wrong " << answers.wrong << ", none " << answers.none);
  CHECK(answers.wrong == 0);
  // Within 20 m: 16 beams of 240 points see little of these streets.
  CHECK(answers.right >= 2 * answers.none);
}

TEST_CASE("a drive elsewhere gets no answer", "[localisation][drives]") {
  const ScannedDrive elsewhere = drive(block(kSeed + 1), {{{0, 0}}, {{120, 0}}, {{120, 80}}}, {}, 2);
  for (const std::size_t first : {20U, 100U})
    CHECK_FALSE(localise(mapped_block().map.map, elsewhere, first, 14));
}

TEST_CASE("places that look alike are not taken for each other", "[localisation][drives]") {
  // The worlds with a seed that localised a drive in another corridor once.
  const auto worlds = lookalikes(540782916U);
  for (const char* const name : {"rows of equal houses", "parallel corridors", "two crossings"}) {
    const Count answers = count_answers(name, worlds.at(name), 540782916U, 370 * kStride, 14);
    INFO(name << ": right " << answers.right << ", none " << answers.none);
    CHECK(answers.wrong == 0);
    CHECK(answers.none > 0);
  }
}

TEST_CASE("places that look alike are not taken for each other, drawn worlds",
          "[.][localisation_lookalikes]") {
  std::mt19937 draw(20261125);
  std::map<std::string, Count> all;
  for (int i = 0; i < 20; ++i) {
    const auto seed = static_cast<std::uint32_t>(draw());
    for (const auto& [name, lookalike] : lookalikes(seed)) {
      const Count answers = count_answers(name, lookalike, seed, 60, 30);
      CHECK(answers.wrong == 0);
      all[name].right += answers.right;
      all[name].wrong += answers.wrong;
      all[name].none += answers.none;
    }
  }
  for (const auto& [name, count] : all)
    WARN(name << ": right " << count.right << ", wrong " << count.wrong << ", none " << count.none);
}

TEST_CASE("two equal crossings give no answer, the road that leaves them does", "[localisation][drives]") {
  ScannedWorld world;
  for (const double x : {50.0, 350.0}) {
    std::mt19937 same(kSeed);
    line_road(world, {x - 50.0, 0.0}, {x + 50.0, 0.0}, same);
  }
  std::mt19937 random(kSeed + 7);
  line_road(world, {400.0, 0.0}, {520.0, 0.0}, random);
  const MapOfDrive map(drive(world, {{{0, 0}}, {{520, 0}}}, {}, kSeed));
  const ScannedDrive later = drive(world, {{{330, 0}}, {{520, 0}}}, {}, kSeed + 1);
  const auto answer = localise(map.map, later, 0, later.keyframes.size());
  REQUIRE(answer);
  CHECK(answer->error_m < 0.3);
  // Not at the second crossing, before anything else comes into range.
  CHECK(answer->keyframes > 20);
}

TEST_CASE("tracking corrects the drift of odometry and ends outside of the map", "[localisation][drives]") {
  ScannedWorld world;
  std::mt19937 random(kSeed);
  line_road(world, {0.0, 0.0}, {320.0, 0.0}, random);
  const MapOfDrive map(drive(world, {{{0, 0}}, {{150, 0}}}, {}, kSeed));
  Drift drift;
  drift.heading_rad_per_m = 5e-5;
  drift.scale = 1.01;
  const ScannedDrive later = drive(changed(world), {{{20, 0}}, {{250, 0}}}, drift, kSeed + 1);
  Localiser localiser(map.map, 50.0);
  double worst_m = 0.0;
  std::size_t compared = 0;
  std::optional<double> outside_m;
  for (std::size_t i = 0; i < later.keyframes.size() && !outside_m; ++i) {
    const Localisation result = localiser.add(later.keyframes[i]);
    const double x = later.truth[i].translation.x();
    if (result.state == LocalisationState::kOutside) outside_m = x;
    if (result.state != LocalisationState::kLocalised || x > 130.0) continue;
    ++compared;
    worst_m = std::max(worst_m, answer_of(result, later.keyframes[i].T_odom_base, later.truth[i], 0).error_m);
  }
  CHECK(compared > 40);
  CHECK(worst_m < 0.06);
  REQUIRE(outside_m);
  CHECK(*outside_m > 150.0);
}

namespace {

/// Localisation of a drive along the street of `map`, which the run that was killed has left at `last_pose`,
/// from its first keyframe on; the result that is not searching any more, or the last one.
Localisation continued(const SavedMap& map, const ScannedDrive& drive, const core::SE3& last_pose) {
  Localiser localiser(map, 50.0, last_pose);
  Localisation result;
  for (std::size_t i = 0; i < drive.keyframes.size(); ++i) {
    result = localiser.add(keyframe_of(drive, 0, i));
    if (result.state != LocalisationState::kSearching) break;
  }
  return result;
}

}  // namespace

TEST_CASE("a run that was killed is continued where the vehicle finds itself, or not at all",
          "[localisation][drives]") {
  ScannedWorld world;
  std::mt19937 random(kSeed);
  line_road(world, {0.0, 0.0}, {200.0, 0.0}, random);
  const ScannedDrive first = drive(world, {{{0, 0}}, {{120, 0}}}, {}, kSeed);
  const MapOfDrive map(first);
  const core::SE3& last_pose = first.truth.back();

  const ScannedDrive back = drive(world, {{{60, 0}}, {{110, 0}}}, {}, kSeed + 2);
  const Localisation found = continued(map.map, back, last_pose);
  REQUIRE(found.state == LocalisationState::kLocalised);
  CHECK((found.T_map_odom.translation - back.truth.front().translation).norm() < 0.3);
  CHECK_THAT(found.event, Catch::Matchers::Contains(" deg from the last pose of the earlier run"));

  const ScannedDrive towed = drive(block(kSeed + 1), {{{0, 0}}, {{120, 0}}}, {}, kSeed + 3);
  CHECK(continued(map.map, towed, last_pose).state == LocalisationState::kElsewhere);
}
