#include "drivers/can/socketcan/can_interface.hpp"
#include "tests/vm/emulated_controllers.hpp"
#include "tests/vm/niliod_run.hpp"
#include "tests/vm/vm_support.hpp"

#include <csignal>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::tests;

TEST_CASE(
    "niliod sets up its controller, restarts it after bus-off, and opens it again after it was unplugged",
    "[can_tier3_niliod]") {
  reset_controllers();
  drivers::set_up_can_interface("can0", 500000, 0);
  NiliodRun run;
  run.write_drive(3.0);
  const auto niliod = run.start_niliod({"imu.interface=can1", "imu.bitrate=500000"});
  REQUIRE(niliod->has_line("info: CAN can1: set to 500000 bit/s and started"));
  CHECK(niliod->has_line("info: CAN can1: up, error-active, 500000 bit/s"));
  CHECK(drivers::query_can_interface("can1").bitrate == 500000U);
  auto play = run.start_playing("can0");
  check_tracking(*niliod, run, "can1");
  CHECK(poses_go_on(*niliod));

  inject("can1 bus-off");
  CHECK(niliod->has_line("warning: CAN can1: bus-off: the controller has given up.*nilio restarts it"));
  CHECK(niliod->has_line(
      "info: CAN can1: up, error-active, 500000 bit/s again after once bus-off, restarted once by nilio"));
  CHECK(poses_go_on(*niliod));

  CHECK(play->stop(SIGTERM) >= 0);
  unplug_controllers();
  CHECK(niliod->has_line("warning: CAN can1: gone; waiting for it"));
  CHECK(niliod->has_line("warning: IMU silent: "));
  plug_in_controllers();
  CHECK(niliod->has_line("info: CAN can1: set to 500000 bit/s and started", 2));
  drivers::set_up_can_interface("can0", 500000, 0);
  REQUIRE(eventually([] { return has_listener("can1"); }));
  play = run.start_playing("can0");
  CHECK(niliod->has_line("info: IMU frames received again after"));
  CHECK(poses_go_on(*niliod));
  CHECK(play->stop(SIGTERM) >= 0);

  const int status = niliod->stop(SIGTERM);
  INFO(niliod->output());
  CHECK(status == 0);
  const auto counters = run.summary()["counters"];
  INFO(counters.dump(1));
  CHECK(counters["can_bus_offs"] == 1);
  CHECK(counters["can_restarts"] == 1);
  CHECK(counters["can_times_gone"] == 1);
  CHECK(counters["can_times_down"] == 0);
  CHECK(counters["can_error_frames"].get<int>() >= 2);
  CHECK(counters["imu_silences"].get<int>() >= 1);
  CHECK(counters["imu_samples"].get<int>() > 200);
  CHECK(counters["poses"].get<int>() > 0);
}

TEST_CASE("niliod does not restart a controller with automatic restart, and counts each bus-off",
          "[can_tier3_niliod]") {
  reset_controllers();
  const NiliodRun run;
  const auto niliod = run.start_niliod({"imu.interface=can1", "imu.bitrate=500000", "imu.restart_ms=1000"});
  REQUIRE(niliod->has_line("info: CAN can1: up, error-active, 500000 bit/s"));
  CHECK(drivers::query_can_interface("can1").restart_ms == 1000U);
  for (std::size_t round = 1; round <= 3; ++round) {
    inject("can1 bus-off");
    CHECK(niliod->has_line("warning: CAN can1: bus-off: .*it restarts itself after 1000 ms", round));
    CHECK(
        niliod->has_line("info: CAN can1: up, error-active, 500000 bit/s again after once bus-off$", round));
  }
  CHECK(niliod->stop(SIGTERM) == 0);
  const auto counters = run.summary()["counters"];
  CHECK(counters["can_bus_offs"] == 3);
  CHECK(counters["can_restarts"] == 0);
}
