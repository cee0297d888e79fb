#include "tests/support/dds_support.hpp"
#include "tests/support/mapper_runs.hpp"
#include "tests/support/scanned_world.hpp"
#include "tests/support/temporary_folder.hpp"

#include <array>
#include <chrono>
#include <csignal>
#include <filesystem>
#include <memory>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include <catch2/catch.hpp>

#include "mapping/map_folder.hpp"

namespace {

using namespace nilio;
using namespace nilio::tests;

/// Messages of a reader that comes late.
struct Received {
  core::SE3 T_map_odom;
  std::vector<core::SE3> poses;  ///< T_map_submap
  std::string correction;
};

core::SE3 read_pose(std::istream& in) {
  std::array<double, 3> position{};
  std::array<double, 4> orientation{};
  read_numbers(in, position);
  read_numbers(in, orientation);
  return {core::from_xyzw(orientation), core::Vector3(position.data())};
}

Received parse(const std::vector<std::string>& lines) {
  Received received;
  for (const std::string& line : lines) {
    std::istringstream in(line);
    std::string word;
    std::string parent;
    std::string child;
    in >> word;
    if (word == "diagnostics") received.correction = line;
    if (word == "transform") {
      read_stamp(in);
      in >> parent >> child;
      CHECK(parent == "map");
      CHECK(child == "odom");
      received.T_map_odom = read_pose(in);
    }
    if (word != "path") continue;
    received.poses.clear();
    while (in >> word) {
      if (word != "pose") continue;
      read_stamp(in);
      in >> parent >> child;
      received.poses.push_back(read_pose(in));
    }
  }
  return received;
}

}  // namespace

TEST_CASE("the map of a drive that returns is corrected on DDS, also after the mapper was killed",
          "[map_correction]") {
  const auto program = mapper_program();
  const auto reader = built_program("nilio-cyclone-reader");
  if (!program || !reader) return;
  const TemporaryFolder folder;
  const std::uint32_t domain = test_domain();
  const auto mapper = make_mapper(*program, folder.path() / "map", [&](ipc::MapperProcessConfig& config) {
    config.publish = true;
    config.domain = domain;
    config.interface_whitelist = {"127.0.0.1"};
  });
  REQUIRE(mapper->start().ok());
  constexpr std::uint32_t kSeed = 3298301173U;
  const ScannedDrive drive = tests::drive(
      block(kSeed), {{{0, 0}}, {{120, 0}}, {{120, 80}}, {{0, 80}}, {{0, 0}}, {{120, 0}}, {{120, 40}}},
      {.heading_rad_per_m = 1e-4, .scale = 1.0, .height_per_m = 0.0}, kSeed);
  // The last keyframes are for the local map.
  std::size_t pushed = 0;
  const auto push = [&] {
    eventually([&] { return mapper->has_room(); });
    mapper->push(*cloud_of(drive.keyframes[pushed++]));
  };
  while (pushed < drive.keyframes.size() - 20) push();
  const auto map_of = [&] { return mapping::MapReader::open(folder.path() / "map").value(); };
  const auto is_closed = [&] {
    const auto map = map_of();
    return mapper->state().loops.load() > 0 && map.last_corrected() == map.submaps().back().id;
  };
  REQUIRE(wait_until_read(*mapper));
  REQUIRE(eventually(is_closed));
  for (const bool is_killed : {false, true}) {
    if (is_killed) {
      kill(mapper->pid(), SIGKILL);
      REQUIRE(eventually([&] {
        const auto event = mapper->poll();
        return event && event->kind == ipc::ProcessEvent::Kind::kStarted;
      }));
    }
    // A correction takes seconds to enter map -> odom.
    Received received;
    double rest_m = 1.0;
    for (int attempt = 0; attempt < 8 && rest_m > 0.002; ++attempt) {
      Program late(kCycloneLoopback + reader->string() + " " + std::to_string(domain) + " 2 30 map");
      REQUIRE(late.line() == "ready");
      // The local map is not kept: a reader that has just matched may miss it.
      std::jthread keyframes([&](const std::stop_token& stop) {
        for (int i = 0; !stop.stop_requested(); ++i) {
          if (i % 60 == 0 && pushed < drive.keyframes.size()) push();
          std::this_thread::sleep_for(std::chrono::milliseconds(20));
        }
      });
      std::vector<std::string> lines;
      while (const auto line = late.line()) lines.push_back(*line);
      keyframes.request_stop();
      keyframes.join();
      INFO((is_killed ? "killed, " : "") << "attempt " << attempt);
      REQUIRE(late.exit_status() == 0);
      received = parse(lines);
      rest_m = (received.T_map_odom.translation - map_of().T_map_odom().translation).norm();
    }
    const auto map = map_of();
    INFO((is_killed ? "killed, " : "") << received.correction);
    CHECK(rest_m <= 0.002);
    CHECK(received.T_map_odom.translation.norm() > 0.1);
    REQUIRE(received.poses.size() == map.submaps().size());
    for (std::size_t i = 0; i < received.poses.size(); ++i)
      CHECK((received.poses[i].translation - map.submaps()[i].T_map_submap.translation).norm() < 1e-6);
    const std::string cause = is_killed ? "restart" : "loop ";
    CHECK(received.correction.find("[nilio: map to odom] [" + cause) != std::string::npos);
    CHECK(received.correction.find("[mode=") != std::string::npos);
  }
  CHECK(mapper->stop(core::Duration::from_seconds(30.0)).back().exit_status == 0);
}
