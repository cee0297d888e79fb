#include "niliod_run.hpp"
#include "vm_support.hpp"

#include <csignal>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::tests;

TEST_CASE(
    "niliod uses an IMU on a live bus, says when the bus is lost, goes on without it, and takes it up "
    "again") {
  const NiliodRun run;
  run.write_drive(12.0);
  VirtualBus bus("vcan0");
  const auto niliod = run.start_niliod({"imu.interface=vcan0"});
  REQUIRE(niliod->says("CAN vcan0: up"));
  const auto play = run.start_playing("vcan0");
  CHECK(niliod->says("tracking: [0-9]+ poses"));
  CHECK(poses_go_on(*niliod));

  set_up("vcan0", false);
  CHECK(niliod->says("warning: CAN vcan0: down; set it up"));
  CHECK(niliod->says(
      "warning: IMU silent: no frame with 0x32, 0x34.*the bus is down.*odometry goes on without"));
  CHECK(poses_go_on(*niliod));
  set_up("vcan0", true);
  CHECK(niliod->says("info: CAN vcan0: up", 2));
  CHECK(niliod->says("info: IMU frames again after"));
  CHECK(poses_go_on(*niliod));

  bus.remove();
  CHECK(niliod->says("warning: CAN vcan0: gone; waiting for it"));
  CHECK(poses_go_on(*niliod));
  bus.add();
  CHECK(niliod->says("info: CAN vcan0: (back, )?up", 3));

  CHECK(play->stop(SIGTERM) >= 0);
  const int status = niliod->stop(SIGTERM);
  INFO(niliod->output());
  CHECK(status == 0);
  CHECK(niliod->count("CAN vcan0: down") == 1);
  CHECK(niliod->count("IMU silent") >= 2);
  const auto counters = run.summary()["counters"];
  CHECK(counters["scans_with_imu"].get<int>() > 10);
  CHECK(counters["poses"].get<int>() > counters["scans_with_imu"].get<int>());
  CHECK(counters["poses_tracking"].get<int>() * 10 > counters["poses"].get<int>() * 9);
  CHECK(counters["imu_samples"].get<int>() > 200);
  CHECK(counters["can_times_down"].get<int>() >= 1);
  CHECK(counters["can_times_gone"] == 1);
  CHECK(counters["imu_silences"].get<int>() >= 2);
}

TEST_CASE("niliod starts before its CAN interface is there, and tells what a wrong IMU sends instead") {
  const NiliodRun run;
  const auto niliod = run.start_niliod({"imu.interface=vcan0", "imu.bitrate=500000"});
  CHECK(niliod->says("warning: CAN vcan0: gone; waiting for it"));
  CHECK(niliod->says("warning: IMU silent.*the bus is gone, nothing else is on it"));
  const VirtualBus bus("vcan0");
  CHECK(niliod->says("info: CAN vcan0: (back, )?up"));
  CHECK(niliod->says("a virtual bus has no bit rate"));
  REQUIRE(eventually([] { return has_listener("vcan0"); }));
  send_from_another_process("vcan0",
                            {data_frame(0x32, {0, 0, 0, 0, 0, 0}), data_frame(0x34, {0, 0, 0, 0, 0, 0})});
  CHECK(niliod->says("IMU frames again"));
  for (int i = 0; i < 5; ++i)
    send_from_another_process("vcan0", {data_frame(0x123, {1}), data_frame(0x456, {2})});
  CHECK(niliod->says("instead there were [0-9]+ frames of other identifiers \\(0x123, 0x456\\)"));
  CHECK(niliod->stop(SIGTERM) == 0);
  const auto counters = run.summary()["counters"];
  CHECK(counters["can_other_frames"] == 10);
  CHECK(counters["imu_frames"] == 2);
}

TEST_CASE("niliod refuses an interface that is not of CAN, and says when none is named") {
  const NiliodRun run;
  const auto wrong = run.start_niliod({"imu.interface=lo"});
  CHECK(wrong->wait() == 1);
  CHECK(wrong->says("niliod: imu.interface: CAN lo: is no CAN interface"));
  CHECK(is_up("lo"));
  const auto none = run.start_niliod({});
  CHECK(none->says("warning: imu.interface is empty: set it to the IMU's CAN interface"));
  CHECK(none->stop(SIGTERM) == 0);
}
