#include "tests/support/eventually.hpp"
#include "tests/support/mapper_runs.hpp"
#include "tests/support/niliod_process.hpp"
#include "tests/support/room_drive.hpp"

#include <chrono>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <random>
#include <string>
#include <sys/wait.h>
#include <thread>
#include <vector>

#include <catch2/catch.hpp>
#include <nlohmann/json.hpp>

#include "mapping/point_cloud.hpp"

using namespace nilio;
using tests::NiliodProcess;
using tests::read_file;
using tests::s_curve;
using tests::stamps_in;
using tests::TemporaryFolder;
using tests::write_room_drive;

namespace {

namespace fs = std::filesystem;

/// The nilio-mapper that a niliod has started, or -1.
pid_t mapper_of(pid_t niliod) {
  std::error_code error;
  for (const auto& entry : fs::directory_iterator("/proc", error)) {
    std::ifstream file(entry.path() / "stat");
    pid_t pid = 0;
    pid_t parent = 0;
    std::string name;
    std::string state;
    if (file >> pid >> name >> state >> parent && parent == niliod && name == "(nilio-mapper)" &&
        state != "Z")
      return pid;
  }
  return -1;
}

bool has_ended(pid_t pid) {
  siginfo_t info{};
  return waitid(P_PID, static_cast<id_t>(pid), &info, WEXITED | WNOHANG | WNOWAIT) != 0 || info.si_pid == pid;
}

std::vector<std::string> replay_arguments(const TemporaryFolder& folder, const std::string& run) {
  return {"--replay", folder.text(), "--output", folder.file(run), "--set", "publisher.enabled=false"};
}

nlohmann::json counters_of(const fs::path& run) {
  return nlohmann::json::parse(read_file(run / "latency.json"))["counters"];
}

}  // namespace

TEST_CASE(
    "a mapper killed at random instants of replays, their end included, changes no bit of the trajectories, "
    "and the maps are complete",
    "[mapper]") {
  const TemporaryFolder folder;
  write_room_drive(folder.path(), s_curve, 6.0, true);
  std::vector<std::string> without_map = replay_arguments(folder, "without");
  without_map.insert(without_map.end(), {"--set", "output.map=false"});
  REQUIRE(NiliodProcess(folder, without_map).wait().status == 0);
  CHECK_FALSE(fs::exists(folder.path() / "without" / "map"));
  REQUIRE(NiliodProcess(folder, replay_arguments(folder, "undisturbed")).wait().status == 0);
  const auto undisturbed = stamps_in(folder.path() / "undisturbed" / "map");
  CHECK(undisturbed.size() == counters_of(folder.path() / "undisturbed")["mapper_keyframes"]);
  const std::string cloud = read_file(folder.path() / "undisturbed" / "map.ply");
  const std::size_t points = std::stoul(cloud.substr(cloud.find("element vertex ") + 15));
  CHECK(points > 1000);
  CHECK(cloud.size() == mapping::kPlyHeaderBytes + points * mapping::kPlyRowBytes);
  const unsigned seed = std::random_device()();
  INFO("seed " << seed);
  std::mt19937 random(seed);
  int kills = 0;
  for (int i = 0; i < 8; ++i) {
    const std::string name = "run" + std::to_string(i);
    const fs::path run = folder.path() / name;
    NiliodProcess niliod(folder, replay_arguments(folder, name));
    int killed = 0;
    pid_t last = -1;
    // The end of a replay starts a mapper three times at most.
    while (killed < 2 && !has_ended(niliod.pid())) {
      const pid_t mapper = mapper_of(niliod.pid());
      if (mapper < 0 || mapper == last) continue;
      std::this_thread::sleep_for(std::chrono::microseconds(random() % 120'000));
      last = mapper;
      if (kill(mapper, SIGKILL) == 0) ++killed;
      if (fs::exists(run / "map" / "map.log") && fs::file_size(run / "map" / "map.log") > 0)
        stamps_in(run / "map");
    }
    const auto finished = niliod.wait();
    INFO(finished.output);
    CHECK(finished.status == 0);
    kills += killed;
    CHECK(read_file(run / "trajectory.tum") == read_file(folder.path() / "without" / "trajectory.tum"));
    const auto counters = counters_of(run);
    CHECK(counters["mapper_keyframes_dropped"] == 0);
    // The mapper loses the keyframe it was working on.
    CHECK(stamps_in(run / "map").size() + static_cast<std::size_t>(killed) >= undisturbed.size());
    CHECK(counters["mapper_submaps"].get<int>() >= 2);
    CHECK(fs::is_empty(run / "map" / "open"));
  }
  CHECK(kills >= 8);
}

TEST_CASE("the end of a replay waits seconds for a mapper that hangs, then has another one complete the map",
          "[mapper]") {
  const TemporaryFolder folder;
  write_room_drive(folder.path(), s_curve, 1.5, false);
  NiliodProcess niliod(folder, replay_arguments(folder, "run"));
  pid_t mapper = -1;
  REQUIRE(tests::eventually([&] { return (mapper = mapper_of(niliod.pid())) > 0; },
                            std::chrono::microseconds(100)));
  REQUIRE(kill(mapper, SIGSTOP) == 0);
  const auto begin = std::chrono::steady_clock::now();
  const auto finished = niliod.wait();
  INFO(finished.output);
  CHECK(finished.status == 0);
  CHECK(std::chrono::steady_clock::now() - begin < std::chrono::seconds(20));
  CHECK(finished.output.find("was killed by signal 9 (Killed) because it made no progress for 5 s") !=
        std::string::npos);
  const auto counters = counters_of(folder.path() / "run");
  CHECK(counters["mapper_restarts"] == 1);
  CHECK(stamps_in(folder.path() / "run" / "map").size() == counters["mapper_keyframes"]);
}

TEST_CASE("a replay whose mapper cannot be started is complete, with one error that names it", "[mapper]") {
  const TemporaryFolder folder;
  write_room_drive(folder.path(), s_curve, 1.0, false);
  const fs::path alone = folder.path() / "bin";
  fs::create_directory(alone);
  fs::copy_file(fs::path(tests::program_folder()) / "niliod", alone / "niliod");
  const auto finished = NiliodProcess(folder, replay_arguments(folder, "run"), {}, alone / "niliod").wait();
  INFO(finished.output);
  CHECK(finished.status == 0);
  CHECK(finished.output.find("install nilio-mapper beside niliod") != std::string::npos);
  CHECK(tests::count_lines(folder.path() / "run" / "trajectory.tum") >= 9);
}
