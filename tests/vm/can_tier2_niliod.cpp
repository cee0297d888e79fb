#include "../unit/room_drive.hpp"
#include "vm_support.hpp"

#include <csignal>
#include <fstream>

#include <catch2/catch.hpp>
#include <nlohmann/json.hpp>

using namespace nilio;
using namespace nilio::tests;

namespace {

constexpr double kRoundS = 12.0;

/// Ends where it begins, so that playing it again and again is one drive without jumps.
core::SE3 rounds(double time_s) {
  const double phase = 2.0 * std::numbers::pi * time_s / kRoundS;
  return {Eigen::Quaterniond(Eigen::AngleAxisd(0.3 * std::sin(phase), core::Vector3::UnitZ())),
          core::Vector3(20.0 - 5.0 * std::cos(phase), 3.0 * std::sin(phase), 0.0)};
}

struct Run {
  TemporaryFolder folder;
  std::string path = folder.path().string();

  [[nodiscard]] std::unique_ptr<Program> start_niliod(const std::vector<std::string>& settings) const {
    std::vector<std::string> words{NILIO_BIN_DIR "/niliod", "--output", path + "/run"};
    for (const char* setting :
         {"lidar.model=VLP-16", "lidar.bind_address=127.0.0.1", "publisher.enabled=false",
          "realtime.lock_memory=false", "output.map=false", "odometry.registration_points=1000"}) {
      words.emplace_back("--set");
      words.emplace_back(setting);
    }
    for (const std::string& setting : settings) {
      words.emplace_back("--set");
      words.push_back(setting);
    }
    return std::make_unique<Program>(words, folder.path() / "niliod.log");
  }
  [[nodiscard]] std::unique_ptr<Program> start_playing() const {
    return std::make_unique<Program>(
        std::vector<std::string>{NILIO_BIN_DIR "/nilio", "play", path, "--to", "127.0.0.1", "--can", "vcan0",
                                 "--restamp", "--loop", "0"},
        folder.path() / "play.log");
  }
  [[nodiscard]] nlohmann::json counters() const {
    return nlohmann::json::parse(std::ifstream(folder.path() / "run" / "latency.json"))["counters"];
  }
};

/// Poses have gone on for some status lines more.
bool poses_go_on(const Program& niliod) {
  const char* status = "[0-9]+ poses \\(\\+[1-9]";
  const std::size_t before = niliod.count(status);
  return eventually([&] { return niliod.count(status) >= before + 2; });
}

}  // namespace

TEST_CASE(
    "niliod uses an IMU on a live bus, says when the bus is lost, goes on without it, and takes it up "
    "again") {
  const Run run;
  write_room_drive(run.folder.path(), rounds, kRoundS, true);
  VirtualBus bus("vcan0");
  const auto niliod = run.start_niliod({"imu.interface=vcan0"});
  REQUIRE(niliod->says("CAN vcan0: up"));
  const auto play = run.start_playing();
  CHECK(niliod->says("tracking: [0-9]+ poses"));
  CHECK(poses_go_on(*niliod));

  set_up("vcan0", false);
  CHECK(niliod->says("warning: CAN vcan0: down; set it up"));
  CHECK(niliod->says(
      "warning: IMU silent: no frame with 0x32, 0x34.*the bus is down.*odometry goes on without"));
  CHECK(poses_go_on(*niliod));
  set_up("vcan0", true);
  CHECK(niliod->says("info: CAN vcan0: up[^]*info: CAN vcan0: up"));
  CHECK(niliod->says("info: IMU frames again after"));
  CHECK(poses_go_on(*niliod));

  bus.remove();
  CHECK(niliod->says("warning: CAN vcan0: gone; waiting for it"));
  CHECK(poses_go_on(*niliod));
  bus.add();
  CHECK(niliod->says("warning: CAN vcan0: gone[^]*info: CAN vcan0: (back, )?up"));

  CHECK(play->stop(SIGTERM) >= 0);
  const int status = niliod->stop(SIGTERM);
  INFO(niliod->output());
  CHECK(status == 0);
  CHECK(niliod->count("CAN vcan0: down") == 1);
  CHECK(niliod->count("IMU silent") >= 2);
  const auto counters = run.counters();
  CHECK(counters["scans_with_imu"].get<int>() > 10);
  CHECK(counters["poses"].get<int>() > counters["scans_with_imu"].get<int>());
  CHECK(counters["poses_tracking"].get<int>() * 10 > counters["poses"].get<int>() * 9);
  CHECK(counters["imu_samples"].get<int>() > 200);
  CHECK(counters["can_times_down"].get<int>() >= 1);
  CHECK(counters["can_times_gone"] == 1);
  CHECK(counters["imu_silences"].get<int>() >= 2);
}

TEST_CASE("niliod starts before its CAN interface is there, and tells what a wrong IMU sends instead") {
  const Run run;
  const auto niliod = run.start_niliod({"imu.interface=vcan0", "imu.bitrate=500000"});
  CHECK(niliod->says("warning: CAN vcan0: gone; waiting for it"));
  CHECK(niliod->says("warning: IMU silent.*the bus is gone, nothing else is on it"));
  const VirtualBus bus("vcan0");
  CHECK(niliod->says("warning: CAN vcan0: gone[^]*info: CAN vcan0: (back, )?up"));
  CHECK(niliod->says("a virtual bus has no bit rate"));
  send_from_another_process("vcan0",
                            {data_frame(0x32, {0, 0, 0, 0, 0, 0}), data_frame(0x34, {0, 0, 0, 0, 0, 0})});
  CHECK(niliod->says("IMU frames again"));
  for (int i = 0; i < 5; ++i)
    send_from_another_process("vcan0", {data_frame(0x123, {1}), data_frame(0x456, {2})});
  CHECK(niliod->says("instead there were [0-9]+ frames of other identifiers \\(0x123, 0x456\\)"));
  CHECK(niliod->stop(SIGTERM) == 0);
  const auto counters = run.counters();
  CHECK(counters["can_other_frames"] == 10);
  CHECK(counters["imu_frames"] == 2);
}

TEST_CASE("niliod refuses an interface that is not of CAN, and says when none is named") {
  const Run run;
  const auto wrong = run.start_niliod({"imu.interface=lo"});
  CHECK(wrong->wait() == 1);
  CHECK(wrong->says("niliod: imu.interface: CAN lo: is no CAN interface"));
  CHECK(is_up("lo"));
  const auto none = run.start_niliod({});
  CHECK(none->says("warning: imu.interface is empty: set it to the IMU's CAN interface"));
  CHECK(none->stop(SIGTERM) == 0);
}
