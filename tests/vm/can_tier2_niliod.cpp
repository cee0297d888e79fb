#include "tests/vm/niliod_run.hpp"
#include "tests/vm/vm_support.hpp"

#include <csignal>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::tests;

TEST_CASE("niliod uses an IMU on a live bus, continues without it while the bus is down, and uses it again",
          "[can_tier2_niliod]") {
  NiliodRun run;
  run.write_drive(12.0);
  const VirtualBus bus("vcan0");
  const auto niliod = run.start_niliod({"imu.interface=vcan0"});
  REQUIRE(niliod->has_line("info: CAN vcan0: up"));
  const auto play = run.start_playing("vcan0");
  check_tracking(*niliod, run, "vcan0");
  if (!imu_is_used(*niliod, run, "vcan0", "whether niliod uses a good IMU")) return;

  set_up("vcan0", false);
  CHECK(niliod->has_line("warning: CAN vcan0: down; set it up"));
  // A starved player can be silent for the same time before; the line then reports that the bus is up.
  CHECK(
      niliod->has_line("warning: IMU silent: no frame with 0x32, 0x34.*odometry continues without the IMU"));
  CHECK(poses_go_on(*niliod));
  set_up("vcan0", true);
  CHECK(niliod->has_line("info: CAN vcan0: up", 2));
  CHECK(niliod->has_line("info: IMU frames received again after"));
  if (!imu_is_used(*niliod, run, "vcan0", "whether niliod uses a good IMU again after a silence")) return;

  const int status = niliod->stop(SIGTERM);
  CHECK(play->stop(SIGTERM) >= 0);
  INFO(niliod->output());
  CHECK(status == 0);
  CHECK(niliod->count("CAN vcan0: down") == 1);
  const auto summary = run.summary();
  const auto& counters = summary["counters"];
  CHECK(counters["scans_with_imu"].get<int>() > 10);
  CHECK(counters["poses"].get<int>() > counters["scans_with_imu"].get<int>());
  CHECK(counters["poses_tracking"].get<int>() * 2 > counters["poses"].get<int>());
  CHECK(counters["imu_samples"].get<int>() > 200);
  CHECK(counters["can_times_down"] == 1);
  CHECK(counters["can_times_gone"] == 0);
  CHECK(counters["imu_silences"].get<std::size_t>() == niliod->count("IMU silent"));
  const auto& imu = summary["imu"];
  CHECK(imu["trusted"] == true);
  CHECK(imu["reason"] == "none");
  CHECK(imu["checks"]["sample_gap"]["worst_state"] == "bad");
  for (const char* check : {"gyro_agreement", "gyro_axes", "gyro_stuck"})
    CHECK(imu["checks"][check]["state"] != "bad");
}

TEST_CASE("niliod reports a missing CAN interface, continues without the IMU, and reads the next interface",
          "[can_tier2_niliod]") {
  NiliodRun run;
  run.write_drive(6.0);
  VirtualBus bus("vcan0");
  const auto niliod = run.start_niliod({"imu.interface=vcan0"});
  REQUIRE(niliod->has_line("info: CAN vcan0: up"));
  auto play = run.start_playing("vcan0");
  check_tracking(*niliod, run, "vcan0");
  bus.remove();
  CHECK(niliod->has_line("warning: CAN vcan0: gone; waiting for it"));
  CHECK(niliod->has_line("warning: IMU silent: "));
  CHECK(poses_go_on(*niliod));
  CHECK(play->stop(SIGTERM) >= 0);
  bus.add();
  CHECK(niliod->has_line("info: CAN vcan0: (back, )?up", 2));
  REQUIRE(eventually([] { return has_listener("vcan0"); }));
  play = run.start_playing("vcan0");
  CHECK(niliod->has_line("info: IMU frames received again after", niliod->count("IMU silent")));
  CHECK(poses_go_on(*niliod));

  const int status = niliod->stop(SIGTERM);
  CHECK(play->stop(SIGTERM) >= 0);
  INFO(niliod->output());
  CHECK(status == 0);
  const auto counters = run.summary()["counters"];
  CHECK(counters["can_times_gone"] == 1);
  CHECK(counters["imu_silences"].get<std::size_t>() == niliod->count("IMU silent"));
  CHECK(counters["imu_samples"].get<int>() > 100);
}

TEST_CASE("niliod starts before its CAN interface exists, and reports the frames of a wrong IMU",
          "[can_tier2_niliod]") {
  const NiliodRun run;
  const auto niliod = run.start_niliod({"imu.preset=xsens_mti", "imu.interface=vcan0", "imu.bitrate=500000"});
  CHECK(niliod->has_line("warning: CAN vcan0: gone; waiting for it"));
  CHECK(niliod->has_line("warning: IMU silent.*the bus is gone, no other frames on the bus"));
  const VirtualBus bus("vcan0");
  CHECK(niliod->has_line("info: CAN vcan0: (back, )?up"));
  CHECK(niliod->has_line("a virtual bus has no bit rate"));
  REQUIRE(eventually([] { return has_listener("vcan0"); }));
  send_from_another_process("vcan0",
                            {data_frame(0x32, {0, 0, 0, 0, 0, 0}), data_frame(0x34, {0, 0, 0, 0, 0, 0})});
  CHECK(niliod->has_line("IMU frames received again"));
  for (int i = 0; i < 5; ++i)
    send_from_another_process("vcan0", {data_frame(0x123, {1}), data_frame(0x456, {2})});
  CHECK(niliod->has_line("received instead: [0-9]+ frames of other identifiers \\(0x123, 0x456\\)"));
  CHECK(niliod->stop(SIGTERM) == 0);
  const auto counters = run.summary()["counters"];
  CHECK(counters["can_other_frames"] == 10);
  CHECK(counters["imu_frames"] == 2);
}

TEST_CASE("niliod rejects an interface that is not CAN, and reports a missing name", "[can_tier2_niliod]") {
  const NiliodRun run;
  const auto wrong = run.start_niliod({"imu.interface=lo"});
  CHECK(wrong->wait() == 1);
  CHECK(wrong->has_line("niliod: imu.interface: CAN lo: is no CAN interface"));
  CHECK(is_up("lo"));
  const auto none = run.start_niliod({});
  CHECK(none->has_line("warning: imu.interface: empty - set it to the IMU's CAN interface"));
  CHECK(none->stop(SIGTERM) == 0);
}
