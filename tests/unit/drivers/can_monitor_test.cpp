#include "drivers/can/can_monitor.hpp"

#include "nilio/drivers/can/can_controller.hpp"

#include <linux/can/netlink.h>
#include <unistd.h>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::drivers;
using Catch::Matchers::Contains;
using Action = CanMonitor::Action;

namespace {

constexpr std::int64_t kStepNs = 100'000'000;

CanInterfaceState seen_with(int controller) {
  return {.present = true,
          .is_can = true,
          .up = true,
          .index = 3,
          .driver = "kvaser_pci",
          .controller = controller,
          .bitrate = 500000,
          .restart_ms = 0,
          .bus_offs = 0};
}

/// A monitor with one reading every 0.1 s.
struct Watched {
  explicit Watched(const CanControllerConfig& config = {.interface_name = "can0"}, bool privileged = true)
      : monitor(config, privileged) {}

  Action observe(const CanInterfaceState& seen) {
    now_ns += kStepNs;
    const Action action = monitor.observe(seen, now_ns);
    for (CanEvent& event : monitor.take_events()) events.push_back(std::move(event));
    return action;
  }
  void observe(const CanInterfaceState& seen, int times) {
    for (int i = 0; i < times; ++i) observe(seen);
  }
  [[nodiscard]] std::string last() const { return events.empty() ? "" : events.back().message; }

  CanMonitor monitor;
  std::int64_t now_ns = 0;
  std::vector<CanEvent> events;
};

}  // namespace

TEST_CASE("each change of a controller's state is reported once, with the remedy", "[can_monitor]") {
  Watched can;
  can.observe(seen_with(CAN_STATE_ERROR_ACTIVE), 20);
  REQUIRE(can.events.size() == 1);
  CHECK(can.last() == "CAN can0: up, error-active, 500000 bit/s");
  CHECK_FALSE(can.events[0].problem);
  can.observe(seen_with(CAN_STATE_ERROR_WARNING), 20);
  can.observe(seen_with(CAN_STATE_ERROR_PASSIVE), 20);
  REQUIRE(can.events.size() == 3);
  CHECK_THAT(can.events[1].message, Contains("error-warning") && Contains("120 ohm"));
  CHECK_THAT(can.events[2].message, Contains("error-passive") && Contains("bit rate"));
  CHECK(can.events[2].problem);
  can.observe(seen_with(CAN_STATE_ERROR_ACTIVE), 20);
  REQUIRE(can.events.size() == 4);
  CHECK_FALSE(can.events[3].problem);
}

TEST_CASE("a short recovery of a controller is not reported", "[can_monitor]") {
  Watched can;
  can.observe(seen_with(CAN_STATE_ERROR_PASSIVE));
  for (int i = 0; i < 50; ++i) {
    can.observe(seen_with(CAN_STATE_ERROR_ACTIVE), 3);
    can.observe(seen_with(CAN_STATE_ERROR_PASSIVE));
  }
  CHECK(can.events.size() == 1);
}

TEST_CASE("bus-off leads to restarts at growing intervals, from 0.1 s to 5 s", "[can_monitor]") {
  Watched can;
  can.observe(seen_with(CAN_STATE_ERROR_ACTIVE));
  std::vector<std::int64_t> restarts;
  for (int i = 0; i < 300; ++i)
    if (can.observe(seen_with(CAN_STATE_BUS_OFF)) == Action::kRestart)
      restarts.push_back(can.now_ns / kStepNs);
  REQUIRE(restarts.size() >= 9);
  CHECK(restarts[0] == 3);
  const std::vector<std::int64_t> waits{2, 4, 8, 16, 32, 50, 50, 50};
  for (std::size_t i = 0; i < waits.size(); ++i) CHECK(restarts[i + 1] - restarts[i] == waits[i]);
  CHECK(can.events.size() == 2);
  CHECK_THAT(can.last(), Contains("bus-off") && Contains("nilio restarts it"));
  CHECK(can.monitor.status().restarts == restarts.size());

  CanInterfaceState well = seen_with(CAN_STATE_ERROR_ACTIVE);
  can.observe(well, 10);
  CHECK(can.events.size() == 3);
  CHECK_THAT(can.last(),
             Contains("error-active") && Contains("restarted " + std::to_string(restarts.size())));
  can.observe(well, 200);
  const std::int64_t again = can.now_ns;
  while (can.observe(seen_with(CAN_STATE_BUS_OFF)) != Action::kRestart)
    REQUIRE(can.now_ns - again < 10 * kStepNs);
  CHECK(can.now_ns - again <= 2 * kStepNs);
}

TEST_CASE(
    "a controller with automatic restart, or without privilege for it, is not restarted, and the log reports "
    "it",
    "[can_monitor]") {
  CanInterfaceState automatic = seen_with(CAN_STATE_BUS_OFF);
  automatic.restart_ms = 100;
  Watched left(CanControllerConfig{.interface_name = "can0"}, true);
  Watched unprivileged(CanControllerConfig{.interface_name = "can0"}, false);
  for (int i = 0; i < 100; ++i) {
    CHECK(left.observe(automatic) == Action::kNone);
    CHECK(unprivileged.observe(seen_with(CAN_STATE_BUS_OFF)) == Action::kNone);
  }
  REQUIRE(left.events.size() == 1);
  CHECK_THAT(left.last(), Contains("restarts itself after 100 ms"));
  REQUIRE(unprivileged.events.size() == 1);
  CHECK_THAT(unprivileged.last(), Contains("CAP_NET_ADMIN") && Contains("ip link set can0 type can restart"));
}

TEST_CASE("a bus-off between two readings is counted from the driver's counter", "[can_monitor]") {
  Watched can;
  CanInterfaceState seen = seen_with(CAN_STATE_ERROR_ACTIVE);
  seen.bus_offs = 7;
  can.observe(seen, 60);
  CHECK(can.monitor.status().bus_offs == 0);
  seen.bus_offs = 10;
  can.observe(seen, 20);
  CHECK(can.monitor.status().bus_offs == 3);
  REQUIRE(can.events.size() == 2);
  CHECK_THAT(can.last(), Contains("was bus-off 3 times"));
}

TEST_CASE("a bit rate is set once per interface, and only where it differs", "[can_monitor]") {
  const CanControllerConfig config{.interface_name = "can0", .bitrate = 500000, .restart_ms = 0};
  SECTION("it is already set, within the tolerance of the clock") {
    Watched can(config);
    CanInterfaceState seen = seen_with(CAN_STATE_ERROR_ACTIVE);
    seen.bitrate = 499000;
    CHECK(can.observe(seen) == Action::kNone);
  }
  SECTION("it differs") {
    Watched can(config);
    CanInterfaceState seen = seen_with(CAN_STATE_ERROR_ACTIVE);
    seen.bitrate = 250000;
    CHECK(can.observe(seen) == Action::kSetUp);
    can.monitor.set_up_result(seen_with(CAN_STATE_ERROR_ACTIVE));
    CHECK(can.observe(seen_with(CAN_STATE_ERROR_ACTIVE)) == Action::kNone);
    REQUIRE(can.events.size() == 2);
    CHECK_THAT(can.events[0].message, Contains("set to 500000 bit/s"));
  }
  SECTION("the interface is down, and is set up again after it was plugged in again") {
    Watched can(config);
    CanInterfaceState down = seen_with(CAN_STATE_STOPPED);
    down.up = false;
    CHECK(can.observe(down) == Action::kSetUp);
    CHECK(can.observe(down) == Action::kNone);
    CHECK(can.observe({}) == Action::kNone);
    down.index = 4;
    CHECK(can.observe(down) == Action::kSetUp);
  }
  SECTION("the controller rejects it") {
    Watched can(config);
    CanInterfaceState seen = seen_with(CAN_STATE_ERROR_ACTIVE);
    seen.bitrate = 250000;
    CHECK(can.observe(seen) == Action::kSetUp);
    can.monitor.set_up_result(seen);
    can.observe(seen, 20);
    CHECK_THAT(can.events[0].message, Contains("cannot do 500000 bit/s"));
    CHECK(can.events.size() == 2);
  }
  SECTION("without privilege") {
    Watched can(config, false);
    CanInterfaceState seen = seen_with(CAN_STATE_ERROR_ACTIVE);
    seen.bitrate = 250000;
    CHECK(can.observe(seen) == Action::kNone);
    can.observe(seen, 20);
    REQUIRE(can.events.size() == 2);
    CHECK_THAT(can.events[0].message,
               Contains("250000 bit/s") && Contains("CAP_NET_ADMIN") && Contains("bitrate 500000"));
  }
}

TEST_CASE("an interface that goes down or disappears and returns is reported once each, and counted",
          "[can_monitor]") {
  Watched can;
  CanInterfaceState down = seen_with(CAN_STATE_STOPPED);
  down.up = false;
  can.observe({}, 10);
  can.observe(seen_with(CAN_STATE_ERROR_ACTIVE), 10);
  can.observe(down, 10);
  can.observe(seen_with(CAN_STATE_ERROR_ACTIVE), 10);
  can.observe({}, 10);
  REQUIRE(can.events.size() == 5);
  CHECK_THAT(can.events[0].message, Contains("gone; waiting for it"));
  CHECK_THAT(can.events[1].message, Contains("back, up, error-active"));
  CHECK_THAT(can.events[2].message, Contains("down") && Contains("ip link set can0 up"));
  CHECK_THAT(can.events[3].message, Contains("up, error-active"));
  CHECK_THAT(can.events[4].message, Contains("gone"));
  CHECK(can.monitor.status().times_gone == 1);
  CanInterfaceState other = seen_with(CAN_STATE_ERROR_ACTIVE);
  can.observe(other, 10);
  other.index = 9;
  can.observe(other, 10);
  REQUIRE(can.events.size() == 7);
  CHECK_THAT(can.last(), Contains("was gone and is back"));
  CHECK(can.monitor.status().times_gone == 2);
  CHECK(can.monitor.status().times_down == 1);
}

TEST_CASE("an interface that is not CAN is never watched: it could be stopped by mistake", "[can_monitor]") {
  const auto network = CanController::watch({.interface_name = "lo", .bitrate = 500000, .restart_ms = 0});
  REQUIRE_FALSE(network.ok());
  CHECK_THAT(network.error().message, Contains("lo: is no CAN interface"));
  CHECK_FALSE(CanController::watch({.interface_name = "a-name-that-is-too-long"}).ok());
  Watched can({.interface_name = "can0", .bitrate = 500000, .restart_ms = 0});
  CanInterfaceState seen;
  seen.present = seen.up = true;
  CHECK(can.observe(seen) == Action::kNone);
  CHECK_THAT(can.last(), Contains("is no CAN interface"));
}

TEST_CASE("a missing interface is watched without waiting", "[can_monitor]") {
  auto controller = CanController::watch({.interface_name = "nilio_none0"});
  REQUIRE(controller.ok());
  std::vector<CanEvent> events;
  for (int i = 0; i < 500 && events.empty(); ++i) {
    usleep(10'000);
    events = (*controller)->take_events();
  }
  REQUIRE(events.size() == 1);
  CHECK_THAT(events[0].message, Contains("nilio_none0: gone; waiting for it"));
  CHECK((*controller)->status().state == CanBusState::kGone);
}
