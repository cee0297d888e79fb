#include "tests/support/mapper_runs.hpp"
#include "tests/support/scanned_world.hpp"
#include "tests/support/temporary_folder.hpp"

#include <chrono>
#include <csignal>
#include <filesystem>
#include <memory>
#include <random>
#include <sys/stat.h>
#include <thread>

#include <catch2/catch.hpp>

#include "mapping/loops/loop_closure.hpp"
#include "mapping/map_correction.hpp"

namespace {

using namespace nilio;
using namespace nilio::tests;

constexpr std::uint32_t kWorldSeed = 3298301173U;
// A sanitizer beside other tests takes 10 s for the loops of a submap.
constexpr core::Duration kLoopPatience = core::Duration::from_seconds(300.0);

/// Once around a block of 400 m and 160 m on, with an odometry that drifts.
const ScannedDrive& block_drive() {
  static const ScannedDrive drive = tests::drive(
      block(kWorldSeed), {{{0, 0}}, {{120, 0}}, {{120, 80}}, {{0, 80}}, {{0, 0}}, {{120, 0}}, {{120, 40}}},
      {.heading_rad_per_m = 1e-4, .scale = 1.0, .height_per_m = 0.0}, kWorldSeed);
  return drive;
}

/// As niliod in a replay: waits for room, and restarts the mapper.
void push(ipc::MapperProcess& mapper, const mapping::Keyframe& keyframe) {
  REQUIRE(eventually(
      [&] {
        mapper.poll();
        return mapper.has_room();
      },
      std::chrono::milliseconds(1)));
  mapper.push(*cloud_of(keyframe));
}

/// The file `poses` that a search from the beginning gives for the submaps of a map: as `nilio map close`.
mapping::Bytes poses_from_scratch(const mapping::MapReader& map) {
  mapping::LoopCloser closer([&](std::uint32_t id) -> std::optional<mapping::Submap> {
    auto submap = map.load(map.submaps().at(id));
    REQUIRE(submap.ok());
    return std::move(submap).value();
  });
  for (const mapping::SubmapEntry& entry : map.submaps()) closer.add(map.load(entry).value());
  closer.finish();
  return encode_correction(correction_of(closer), map.header().id);
}

/// The map is whole, and its loops and poses are those of a search from the beginning.
void check_closed(const std::filesystem::path& folder) {
  const auto map = mapping::MapReader::open(folder);
  REQUIRE(map.ok());
  CHECK(map->warning().empty());
  CHECK(std::count_if(map->loops().begin(), map->loops().end(), [](const mapping::Loop& loop) {
          return loop.verdict == mapping::LoopVerdict::kAccepted;
        }) >= 2);
  // A mapper without the time for all loops has corrected fewer submaps.
  REQUIRE(map->last_corrected() == map->submaps().back().id);
  const auto poses = mapping::read_bytes(folder / "poses");
  REQUIRE(poses.ok());
  const bool is_as_from_scratch = *poses == poses_from_scratch(*map);
  CHECK(is_as_from_scratch);
  for (const auto& file : std::filesystem::directory_iterator(folder))
    CHECK(file.path().filename().string().find(".tmp.") == std::string::npos);
}

}  // namespace

TEST_CASE("loops are closed while keyframes arrive, with the poses of nilio map close", "[live_loops]") {
  const auto program = mapper_program();
  if (!program) return;
  const TemporaryFolder folder;
  const auto mapper = make_mapper(*program, folder.path() / "map");
  REQUIRE(mapper->start().ok());
  for (const mapping::Keyframe& keyframe : block_drive().keyframes) push(*mapper, keyframe);
  CHECK(eventually([&] { return mapper->state().loops.load() > 0; }));
  CHECK(mapper->running());
  const auto ends = mapper->stop(kLoopPatience);
  REQUIRE(ends.size() == 1);
  CHECK(ends.front().exit_status == 0);
  CHECK(stamps_in(folder.path() / "map").size() == block_drive().keyframes.size());
  check_closed(folder.path() / "map");
  const auto map = mapping::MapReader::open(folder.path() / "map");
  REQUIRE(map.ok());
  // The end has drifted by metres; the street that it meets again has not.
  const mapping::SubmapEntry& last = map->submaps().back();
  CHECK((last.T_map_submap.translation - last.T_odom_submap.translation).norm() > 1.0);
  CHECK(map->T_map_odom().translation.norm() > 0.1);
}

TEST_CASE(
    "a mapper killed at drawn instants of searches and solutions has the loops of a mapper that was not",
    "[live_loops]") {
  const auto program = mapper_program();
  if (!program) return;
  const unsigned seed = std::random_device()();
  INFO("seed " << seed);
  std::mt19937 random(seed);
  const TemporaryFolder folder;
  const auto map_folder = folder.path() / "map";
  const auto mapper = make_mapper(*program, map_folder);
  REQUIRE(mapper->start().ok());
  int kills = 0;
  std::size_t most_loops = 0;
  const auto kill_now = [&] {
    if (!mapper->running()) return;
    kill(mapper->pid(), SIGKILL);
    ++kills;
    if (!std::filesystem::exists(map_folder / "map.log")) return;
    const auto map = mapping::MapReader::open(map_folder);
    REQUIRE(map.ok());
    CHECK(map->warning().empty());
    // Known loops stay known.
    CHECK(map->loops().size() >= most_loops);
    most_loops = map->loops().size();
  };
  for (const mapping::Keyframe& keyframe : block_drive().keyframes) {
    push(*mapper, keyframe);
    if (random() % 40 != 0) continue;
    REQUIRE(wait_until_read(*mapper));
    std::this_thread::sleep_for(std::chrono::milliseconds(random() % 400));
    kill_now();
  }
  REQUIRE(wait_until_read(*mapper));
  // The loops of the end of the drive.
  for (int i = 0; i < 5; ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(random() % 1500));
    mapper->poll();
    kill_now();
    REQUIRE(eventually([&] {
      mapper->poll();
      return mapper->running();
    }));
  }
  const auto ends = mapper->stop(kLoopPatience);
  REQUIRE_FALSE(ends.empty());
  CHECK(ends.back().exit_status == 0);
  CHECK(kills >= 5);
  CHECK(mapper->state().failed_writes.load() == 0);
  check_closed(map_folder);
}

TEST_CASE("a search that hangs delays neither keyframes nor submaps nor the end", "[live_loops][timed]") {
  const auto program = mapper_program();
  if (!program) return;
  const TemporaryFolder folder;
  const auto map_folder = folder.path() / "map";
  const auto mapper = make_mapper(*program, map_folder);
  REQUIRE(mapper->start().ok());
  const auto& keyframes = block_drive().keyframes;
  for (std::size_t i = 0; i < 200; ++i) push(*mapper, keyframes[i]);
  REQUIRE(eventually([&] { return std::filesystem::exists(map_folder / "poses"); }));
  // Nobody writes into it: the thread that opens it to compare a place with the first one waits for ever.
  const auto first = mapping::submap_path(map_folder, 0);
  std::filesystem::rename(first, folder.path() / "first");
  REQUIRE(mkfifo(first.c_str(), 0600) == 0);
  for (std::size_t i = 200; i < keyframes.size(); ++i) push(*mapper, keyframes[i]);
  REQUIRE(wait_until_read(*mapper));
  CHECK(mapper->keyframes().dropped() == 0);
  // A process that is killed after its patience has another status.
  const auto ends = mapper->stop(core::Duration::from_seconds(3.0));
  REQUIRE(ends.size() == 1);
  CHECK(ends.front().exit_status == 0);
  std::filesystem::rename(folder.path() / "first", first);
  CHECK(stamps_in(map_folder).size() == keyframes.size());
  CHECK(std::filesystem::is_empty(map_folder / "open"));
  const auto map = mapping::MapReader::open(map_folder);
  CHECK(map->warning().empty());
  CHECK(map->last_corrected() < map->submaps().back().id);
}

TEST_CASE("a mapper that does not close loops writes no poses", "[live_loops]") {
  const auto program = mapper_program();
  if (!program) return;
  const TemporaryFolder folder;
  const auto mapper = make_mapper(*program, folder.path() / "map",
                                  [](ipc::MapperProcessConfig& config) { config.closes_loops = false; });
  REQUIRE(mapper->start().ok());
  for (int i = 0; i < 60; ++i) push(*mapper, block_drive().keyframes[static_cast<std::size_t>(i)]);
  CHECK(mapper->stop(core::Duration::from_seconds(30.0)).size() == 1);
  CHECK(stamps_in(folder.path() / "map").size() == 60);
  CHECK_FALSE(std::filesystem::exists(folder.path() / "map" / "poses"));
}
