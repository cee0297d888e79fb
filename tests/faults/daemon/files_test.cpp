#include "tests/support/niliod_process.hpp"
#include "tests/support/paths.hpp"
#include "tests/support/room_drive.hpp"
#include "tests/support/udp_support.hpp"

#include <array>
#include <chrono>
#include <csignal>
#include <cstring>
#include <optional>
#include <string>
#include <sys/mount.h>
#include <thread>

#include <catch2/catch.hpp>
#include <nlohmann/json.hpp>

using namespace nilio;
using namespace std::chrono_literals;
using Catch::Matchers::Contains;
using tests::count_lines;
using tests::kNoPublisher;
using tests::NiliodProcess;
using tests::read_file;
using tests::s_curve;
using tests::TemporaryFolder;
using tests::write_room_drive;

namespace {

namespace fs = std::filesystem;

std::vector<std::string> as_live(const TemporaryFolder& drive, const std::vector<std::string>& more) {
  std::vector<std::string> arguments{"--replay", drive.path().string(), "--as-live", "--set",
                                     "realtime.lock_memory=false"};
  arguments.insert(arguments.end(), more.begin(), more.end());
  return arguments;
}

double seconds_since(std::chrono::steady_clock::time_point begin) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

/// A disk that stops answering while its flag exists.
class SlowDisk {
 public:
  explicit SlowDisk(fs::path folder) : folder_(std::move(folder)) { fs::create_directories(folder_); }
  void stop() { std::ofstream(flag()) << "stopped"; }
  void go_on() { fs::remove(flag()); }
  [[nodiscard]] NiliodProcess::Environment environment() const {
    return {{"LD_PRELOAD", library()},
            {"NILIO_DISK_FOLDER", folder_.string()},
            {"NILIO_DISK_STOPPED_FILE", flag().string()}};
  }
  /// False in programs whose sanitizer replaces the same functions.
  static bool is_available() {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
    return false;
#else
    return fs::exists(library());
#endif
  }

 private:
  static std::string library() { return nilio::tests::program_folder() + "/libnilio-slow-disk.so"; }
  [[nodiscard]] fs::path flag() const { return folder_.string() + ".stopped"; }
  fs::path folder_;
};

/// Number of poses in a trajectory after `seconds`.
std::size_t poses_in(const fs::path& run) { return count_lines(run / "trajectory.tum"); }

}  // namespace

TEST_CASE("a killed run keeps its trajectory and decisions but for the last second", "[files][timed]") {
  const TemporaryFolder folder;
  write_room_drive(folder.path(), s_curve, 6.0, true);
  const fs::path run = folder.path() / "run";
  NiliodProcess niliod(folder, as_live(folder, {"--output", run.string(), "--set", kNoPublisher}));
  REQUIRE(tests::eventually([&] { return poses_in(run) >= 5; }));
  std::this_thread::sleep_for(3s);
  REQUIRE(kill(niliod.pid(), SIGKILL) == 0);
  const auto finished = niliod.wait();
  INFO(finished.output);
  CHECK(finished.status == -SIGKILL);
  // 3 s after the fifth pose, at 10 poses a second and at most one second lost.
  CHECK(poses_in(run) >= 25);
  CHECK(count_lines(run / "trajectory.kitti") == poses_in(run));
  CHECK(count_lines(run / "decisions.jsonl") + 10 >= poses_in(run));
}

TEST_CASE("a recorded run that was killed under load is repeated to the bit by its folder alone", "[files]") {
  const TemporaryFolder folder;
  write_room_drive(folder.path(), s_curve, 6.0, true);
  const fs::path box = folder.path() / "box";
  const fs::path run = folder.path() / "run";
  // A budget far too small: levels, guard and superseded scans depend on the clock.
  NiliodProcess niliod(folder, as_live(folder, {"--output", run.string(), "--record", box.string(), "--set",
                                                kNoPublisher, "--set", "odometry.budget_ms=0.7"}));
  REQUIRE(tests::eventually([&] { return poses_in(run) >= 30; }));
  REQUIRE(kill(niliod.pid(), SIGKILL) == 0);
  CHECK(niliod.wait().status == -SIGKILL);
  fs::remove(folder.path() / "lidar.pcap");
  fs::remove(folder.path() / "imu.log");

  const fs::path again = folder.path() / "again";
  NiliodProcess repeated(folder, {"--decisions", box.string(), "--output", again.string()});
  const auto finished = repeated.wait();
  INFO(finished.output);
  // With that budget tracking may be lost, which is repeated, too.
  REQUIRE((finished.status == 0 || finished.status == 3));
  CHECK_THAT(finished.output, !Contains("do not match the decision log"));
  const std::string first = read_file(run / "trajectory.tum");
  const std::string second = read_file(again / "trajectory.tum");
  const std::size_t common = std::min(first.size(), second.size());
  // At most a second of poses is missing on either side.
  CHECK(std::count(first.begin(), first.end(), '\n') <= std::count(second.begin(), second.end(), '\n') + 10);
  CHECK(common > 1000);
  CHECK(first.substr(0, common) == second.substr(0, common));
}

TEST_CASE("a live run on sockets is repeated to the bit from its black box", "[files]") {
  const TemporaryFolder folder;
  write_room_drive(folder.path(), s_curve, 5.0, false);
  auto capture = drivers::open_pcap((folder.path() / "lidar.pcap").string(), {});
  REQUIRE(capture.ok());
  const std::uint16_t port = tests::free_port();
  const fs::path box = folder.path() / "box";
  const fs::path run = folder.path() / "run";
  NiliodProcess niliod(
      folder,
      {"--output", run.string(), "--record", box.string(), "--set", "lidar.bind_address=127.0.0.1", "--set",
       "lidar.port=" + std::to_string(port), "--set", "lidar.position_port=0", "--set", "imu.enabled=false",
       "--set", kNoPublisher, "--set", "realtime.lock_memory=false", "--set", "output.map=false"});
  REQUIRE_FALSE(niliod.await("(UDP 127.0.0.1)").empty());
  tests::UdpSender sender;
  std::array<drivers::Packet, 1> packet;
  const auto begin = std::chrono::steady_clock::now();
  std::optional<core::Time> first;
  while ((*capture)->read(packet, {}).state == drivers::SourceState::kData) {
    if (!first) first = packet[0].stamp;
    std::this_thread::sleep_until(begin + std::chrono::nanoseconds((packet[0].stamp - *first).ns));
    sender.send(port, {packet[0].data.begin(), packet[0].data.begin() + packet[0].size});
  }
  std::this_thread::sleep_for(300ms);
  REQUIRE(kill(niliod.pid(), SIGTERM) == 0);
  const auto live = niliod.wait();
  INFO(live.output);
  REQUIRE(live.status == 0);
  CHECK(poses_in(run) >= 40);
  const fs::path again = folder.path() / "again";
  const auto repeated =
      NiliodProcess(folder, {"--decisions", run.string(), "--output", again.string()}).wait();
  INFO(repeated.output);
  REQUIRE(repeated.status == 0);
  CHECK(read_file(again / "trajectory.tum") == read_file(run / "trajectory.tum"));
}

TEST_CASE("a recording is not continued, and a folder without one is refused by name", "[files]") {
  const TemporaryFolder folder;
  write_room_drive(folder.path(), s_curve, 1.0, false);
  const auto onto = NiliodProcess(folder, as_live(folder, {"--record", folder.path().string()})).wait();
  CHECK(onto.status == 1);
  CHECK_THAT(onto.output, Contains("contains a recording already"));
  const auto without = NiliodProcess(folder, {"--decisions", folder.path().string()}).wait();
  CHECK(without.status == 1);
  CHECK_THAT(without.output, Contains("decisions.jsonl") && Contains("--record"));
}

TEST_CASE("a disk that does not answer is reported, delays nothing, and ends nothing", "[files][timed]") {
  if (!SlowDisk::is_available()) {
    WARN("skipped: a sanitizer replaces the functions that the slow disk replaces");
    return;
  }
  const TemporaryFolder folder;
  write_room_drive(folder.path(), s_curve, 9.0, false);
  const fs::path run = folder.path() / "disk" / "run";
  SlowDisk disk(folder.path() / "disk");
  NiliodProcess niliod(folder,
                       as_live(folder, {"--output", run.string(), "--set", tests::own_domain(), "--set",
                                        "publisher.interfaces=[\"127.0.0.1\"]"}),
                       disk.environment());
  const std::string publisher = niliod.await("nilio-publisher started, pid ([0-9]+)");
  REQUIRE_FALSE(publisher.empty());
  REQUIRE(tests::eventually([&] { return poses_in(run) >= 10; }));
  disk.stop();
  CHECK_FALSE(niliod.await("files: (the disk has taken no data)").empty());
  // The supervisor goes on: a dead publisher is started again meanwhile.
  const auto killed = std::chrono::steady_clock::now();
  REQUIRE(kill(static_cast<pid_t>(std::stol(publisher)), SIGKILL) == 0);
  CHECK_FALSE(niliod.await("started again as process ([0-9]+)").empty());
  CHECK(seconds_since(killed) < 1.0);
  SECTION("the disk comes back: every pose is in the files") {
    disk.go_on();
    CHECK_FALSE(niliod.await("files: (the disk takes data again)").empty());
    const auto finished = niliod.wait();
    INFO(finished.output);
    CHECK(finished.status == 0);
    const auto report = nlohmann::json::parse(read_file(run / "latency.json"));
    CHECK(report["counters"]["files_poses_dropped"] == 0);
    CHECK(report["counters"]["poses"] == report["counters"]["scans"]);
    CHECK(poses_in(run) == report["counters"]["poses"].get<std::size_t>());
  }
  SECTION("SIGTERM ends the process within two seconds") {
    const auto asked = std::chrono::steady_clock::now();
    REQUIRE(kill(niliod.pid(), SIGTERM) == 0);
    const auto finished = niliod.wait();
    INFO(finished.output);
    CHECK(seconds_since(asked) < 2.0);
    CHECK(finished.status == 1);
    CHECK_THAT(finished.output, Contains("files of this run are incomplete"));
  }
}

TEST_CASE("a full disk is reported once, poses continue, and files go on with free space", "[files]") {
  const TemporaryFolder folder;
  write_room_drive(folder.path(), s_curve, 9.0, false);
  const fs::path disk = folder.path() / "disk";
  fs::create_directories(disk);
  if (mount("nilio-test", disk.c_str(), "tmpfs", 0, "size=256k") != 0) {
    WARN("skipped: no file system of its own can be mounted (" << std::strerror(errno) << ")");
    return;
  }
  const fs::path run = disk / "run";
  {
    NiliodProcess niliod(folder, as_live(folder, {"--output", run.string(), "--set", kNoPublisher, "--set",
                                                  "output.map=false", "--set", "output.run_mcap=false"}));
    REQUIRE(tests::eventually([&] { return poses_in(run) >= 10; }));
    {
      std::ofstream filler(disk / "filler", std::ios::binary);
      filler << std::string(1'000'000, 'x');
    }
    CHECK_FALSE(niliod.await("(cannot be written) .No space left").empty());
    std::this_thread::sleep_for(1s);
    fs::remove(disk / "filler");
    CHECK_FALSE(niliod.await("(writable again), 0 records were dropped").empty());
    const auto finished = niliod.wait();
    INFO(finished.output);
    CHECK(finished.status == 0);
    const auto report = nlohmann::json::parse(read_file(run / "latency.json"));
    CHECK(report["counters"]["poses"] == report["counters"]["scans"]);
    CHECK(poses_in(run) == report["counters"]["poses"].get<std::size_t>());
  }
  CHECK(umount(disk.c_str()) == 0);
}
