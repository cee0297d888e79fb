#include "ipc/mapper_process.hpp"

#include "tests/support/mapper_runs.hpp"
#include "tests/support/street.hpp"
#include "tests/support/temporary_folder.hpp"

#include <algorithm>
#include <chrono>
#include <csignal>
#include <filesystem>
#include <memory>
#include <optional>
#include <random>
#include <set>
#include <thread>

#include <catch2/catch.hpp>

#include "mapping/map_folder.hpp"

namespace {

using namespace nilio;
using namespace nilio::tests;

void push_street(ipc::MapperProcess& mapper, int keyframes) {
  for (int i = 0; i < keyframes; ++i) {
    REQUIRE(eventually([&] { return mapper.has_room(); }));
    mapper.push(*cloud_of(street_keyframe(i, 300)));
  }
}

}  // namespace

TEST_CASE("the mapper writes what it is given, and completes the map when it is stopped",
          "[mapper_process]") {
  const auto program = mapper_program();
  if (!program) return;
  const TemporaryFolder folder;
  const auto mapper = make_mapper(*program, folder.path() / "map");
  REQUIRE(mapper->start().ok());
  push_street(*mapper, 90);
  const auto ends = mapper->stop(core::Duration::from_seconds(30.0));
  REQUIRE(ends.size() == 1);
  CHECK(ends.front().exit_status == 0);
  CHECK(mapper->keyframes().dropped() == 0);
  CHECK(mapper->state().keyframes.load() == 90);
  CHECK(mapper->state().failed_writes.load() == 0);
  CHECK(stamps_in(folder.path() / "map").size() == 90);
  CHECK(std::filesystem::is_empty(folder.path() / "map" / "open"));
}

TEST_CASE("complete submaps come back, each once and as they are on disk", "[mapper_process]") {
  const auto program = mapper_program();
  if (!program) return;
  const TemporaryFolder folder;
  const auto mapper = make_mapper(*program, folder.path() / "map",
                                  [](ipc::MapperProcessConfig& config) { config.returns_submaps = true; });
  REQUIRE(mapper->submaps());
  REQUIRE(mapper->start().ok());
  push_street(*mapper, 90);
  REQUIRE(wait_until_read(*mapper));
  const auto ends = mapper->stop(core::Duration::from_seconds(30.0));
  REQUIRE_FALSE(ends.empty());
  CHECK(ends.back().exit_status == 0);
  const auto map = mapping::MapReader::open(folder.path() / "map");
  REQUIRE(map.ok());
  REQUIRE(map->submaps().size() > 1);
  // Without a reader the newest remain.
  const auto returned = std::make_unique<ipc::SubmapCloud>();
  std::size_t read = 0;
  while (mapper->submaps()->read(*returned)) {
    ++read;
    CAPTURE(returned->id);
    REQUIRE(returned->id < map->submaps().size());
    const auto submap = map->load(map->submaps()[returned->id]);
    REQUIRE(submap.ok());
    CHECK(returned->stamp_ns == submap->keyframes.front().stamp.ns);
    REQUIRE(returned->count == std::min(submap->surfaces.size(), ipc::SubmapCloud::kCapacity));
    const core::Vector3 first = submap->T_odom_submap * submap->surfaces.front().mean.cast<double>();
    const auto distance = [&](const ipc::CloudPoint& point) {
      return (core::Vector3(point.x, point.y, point.z) - first).norm();
    };
    double nearest = 1e9;
    for (std::size_t i = 0; i < returned->count; ++i)
      nearest = std::min(nearest, distance(returned->points[i]));
    // Means are stored in steps of 1/256 of a voxel.
    CHECK(nearest < 0.01);
  }
  CHECK(read + mapper->submaps()->dropped() == map->submaps().size());
  CHECK(read >= std::min<std::size_t>(map->submaps().size(), mapper->submaps()->capacity() - 1));
  CHECK(make_mapper(*program, folder.path() / "other")->submaps() == nullptr);
}

TEST_CASE(
    "a mapper that is killed at random instants leaves a readable map each time, and loses at most the "
    "keyframes it was working on",
    "[mapper_process]") {
  const auto program = mapper_program();
  if (!program) return;
  const TemporaryFolder folder;
  const auto map_folder = folder.path() / "map";
  const auto mapper = make_mapper(*program, map_folder);
  REQUIRE(mapper->start().ok());
  std::mt19937 random(17);
  int kills = 0;
  constexpr int kKeyframes = 250;
  for (int i = 0; i < kKeyframes; ++i) {
    mapper->poll();
    REQUIRE(eventually([&] {
      mapper->poll();
      return mapper->has_room();
    }));
    mapper->push(*cloud_of(street_keyframe(i, 200)));
    if (i % 10 != 9) continue;
    REQUIRE(wait_until_read(*mapper));
    // In the middle of the next ones.
    mapper->push(*cloud_of(street_keyframe(i, 200)));
    std::this_thread::sleep_for(std::chrono::microseconds(random() % 3000U));
    if (!mapper->running()) continue;
    kill(mapper->pid(), SIGKILL);
    ++kills;
    if (std::filesystem::exists(map_folder / "map.log")) stamps_in(map_folder);
  }
  REQUIRE(wait_until_read(*mapper));
  const auto ends = mapper->stop(core::Duration::from_seconds(30.0));
  REQUIRE_FALSE(ends.empty());
  CHECK(ends.back().exit_status == 0);
  CHECK(kills > 15);
  const auto stamps = stamps_in(map_folder);
  CHECK(static_cast<int>(stamps.size()) >= kKeyframes - kills);
  CHECK(mapper->state().failed_writes.load() == 0);
}

TEST_CASE("a mapper that is dead when it is stopped is started once more to complete the map",
          "[mapper_process]") {
  const auto program = mapper_program();
  if (!program) return;
  const TemporaryFolder folder;
  const auto mapper = make_mapper(*program, folder.path() / "map");
  REQUIRE(mapper->start().ok());
  push_street(*mapper, 40);
  REQUIRE(wait_until_read(*mapper));
  kill(mapper->pid(), SIGKILL);
  const auto ends = mapper->stop(core::Duration::from_seconds(30.0));
  REQUIRE(ends.size() == 2);
  CHECK(ends.front().signal == SIGKILL);
  CHECK(ends.back().exit_status == 0);
  CHECK(mapper->restarts() == 1);
  // The last keyframe may have been read and not yet written.
  CHECK(stamps_in(folder.path() / "map").size() >= 39);
  CHECK(mapper->state().submaps.load() == 2);
}

TEST_CASE("pushing never waits for a mapper that does not exist", "[mapper_process]") {
  const TemporaryFolder folder;
  const auto mapper = make_mapper("/nonexistent/nilio-mapper", folder.path() / "map");
  CHECK_FALSE(mapper->start().ok());
  const auto cloud = cloud_of(street_keyframe(0, 100));
  const auto before = std::chrono::steady_clock::now();
  for (int i = 0; i < 1000; ++i) mapper->push(*cloud);
  CHECK(std::chrono::steady_clock::now() - before < std::chrono::seconds(5));
  CHECK_FALSE(mapper->has_room());
  CHECK(mapper->keyframes().written() == 1000);
}
