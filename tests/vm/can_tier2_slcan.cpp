#include "nilio/drivers/can/can_controller.hpp"
#include "nilio/drivers/can/socketcan/socketcan.hpp"

#include "drivers/can/socketcan/can_interface.hpp"
#include "tests/vm/controller_log.hpp"
#include "tests/vm/slcan_adapter.hpp"
#include "tests/vm/vm_support.hpp"

#include <linux/can/error.h>
#include <linux/can/netlink.h>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::tests;
using drivers::CanBusState;

TEST_CASE("a serial adapter is set to the requested bit rate, started, and transmits frames both ways",
          "[can_tier2_slcan]") {
  const SlcanAdapter adapter;
  const std::string& name = adapter.interface_name();
  ControllerLog log({.interface_name = name, .bitrate = 500000, .restart_ms = 0});
  CHECK(log.has_line("set to 500000 bit/s and started"));
  CHECK(log.has_line("up, error-active, 500000 bit/s"));
  CHECK(eventually([&] { return adapter.received().find("S6\rO\r") != std::string::npos; }));
  CHECK(is_up(name));

  const auto source = drivers::open_socketcan({.interface_name = name});
  REQUIRE(source.ok());
  adapter.say("t12321122");
  const auto received = read_frames(**source, 1);
  REQUIRE(received.size() == 1);
  CHECK(received[0].id == 0x123);
  CHECK(received[0].length == 2);
  CHECK(received[0].data[1] == 0x22);
  send_from_another_process(name, {data_frame(0x7A, {0xBE, 0xEF})});
  CHECK(eventually([&] { return adapter.received().find("t07A2BEEF\r") != std::string::npos; }));
}

TEST_CASE("a bit rate that is already set leaves a running interface undisturbed", "[can_tier2_slcan]") {
  const SlcanAdapter adapter;
  drivers::set_up_can_interface(adapter.interface_name(), 250000, 0);
  REQUIRE(is_up(adapter.interface_name()));
  CHECK(eventually([&] { return adapter.received().find("O\r") != std::string::npos; }));
  const std::string before = adapter.received();
  ControllerLog log({.interface_name = adapter.interface_name(), .bitrate = 250000, .restart_ms = 0});
  CHECK(log.has_line("up, error-active, 250000 bit/s"));
  CHECK(adapter.received() == before);
  CHECK(log.events().size() == 1);
}

TEST_CASE("errors of the adapter reach sockets as error frames, and the log as changes of state, each once",
          "[can_tier2_slcan]") {
  const SlcanAdapter adapter;
  const std::string& name = adapter.interface_name();
  drivers::set_up_can_interface(name, 500000, 0);
  const auto source = drivers::open_socketcan({.interface_name = name});
  REQUIRE(source.ok());
  ControllerLog log({.interface_name = name});
  REQUIRE(log.has_line("error-active"));
  adapter.say("e1a");
  adapter.say("sw057100");
  CHECK(log.has_line("error-warning: there are errors on the bus"));
  adapter.say("sp130140");
  CHECK(log.has_line("error-passive: there are errors on the bus"));
  const auto frames = read_frames(**source, 3);
  REQUIRE(frames.size() == 3);
  for (const auto& frame : frames) CHECK(frame.error);
  CHECK((frames[0].id & CAN_ERR_ACK) != 0);
  CHECK((frames[1].id & CAN_ERR_CRTL) != 0);
  CHECK((frames[2].id & CAN_ERR_CRTL) != 0);
  CHECK(frames[2].data[1] != 0);
  adapter.say("sa000000");
  CHECK(log.has_line("up, error-active, 500000 bit/s$", 2));
  CHECK(log.events().size() == 4);
}

TEST_CASE("bus-off of an adapter without restart ends by stopping and starting it, and frames arrive again",
          "[can_tier2_slcan]") {
  const SlcanAdapter adapter;
  const std::string& name = adapter.interface_name();
  ControllerLog log({.interface_name = name, .bitrate = 500000, .restart_ms = 100});
  CHECK(log.has_line("its driver has no automatic restart"));
  REQUIRE(log.has_line("up, error-active"));
  const auto source = drivers::open_socketcan({.interface_name = name});
  REQUIRE(source.ok());
  for (std::uint64_t round = 1; round <= 2; ++round) {
    const std::string before = adapter.received();
    adapter.say("sb000256");
    CHECK(log.has_line("bus-off: the controller has given up", round));
    CHECK(
        log.has_line("error-active, 500000 bit/s again after once bus-off, restarted once by nilio", round));
    CHECK(eventually([&] {
      const std::string since = adapter.received().substr(before.size());
      const std::size_t closed = since.find("C\r");
      return closed != std::string::npos && since.find("O\r", closed) != std::string::npos;
    }));
    CHECK(log.status().bus_offs == round);
    CHECK(log.status().restarts == round);
    CHECK(eventually([&] {
      adapter.say("t1230");
      for (const auto& frame : read_frames(**source, 1, 0.1))
        if (!frame.error) return true;
      return false;
    }));
  }
  CHECK(eventually([&] {
    read_frames(**source, 1, 0.01);
    return source.value()->status().find("2 times bus-off") != std::string::npos;
  }));
}

TEST_CASE("an adapter that is unplugged and plugged in again is set up and read again", "[can_tier2_slcan]") {
  auto adapter = std::make_unique<SlcanAdapter>();
  const std::string name = adapter->interface_name();
  ControllerLog log({.interface_name = name, .bitrate = 500000, .restart_ms = 0});
  REQUIRE(log.has_line("up, error-active"));
  const auto source = drivers::open_socketcan({.interface_name = name});
  REQUIRE(source.ok());
  adapter.reset();
  CHECK(log.has_line("gone; waiting for it"));
  adapter = std::make_unique<SlcanAdapter>();
  REQUIRE(adapter->interface_name() == name);
  CHECK(log.has_line("set to 500000 bit/s and started", 2));
  CHECK(log.has_line("up, error-active", 2));
  CHECK(eventually([&] {
    adapter->say("t1230");
    return !read_frames(**source, 1, 0.1).empty();
  }));
  CHECK(log.status().times_gone == 1);
}

TEST_CASE(
    "a bit rate that the controller does not support is rejected with a log line, and the interface "
    "continues unchanged",
    "[can_tier2_slcan]") {
  const SlcanAdapter adapter;
  drivers::set_up_can_interface(adapter.interface_name(), 250000, 0);
  REQUIRE(is_up(adapter.interface_name()));
  ControllerLog log({.interface_name = adapter.interface_name(), .bitrate = 123456, .restart_ms = 0});
  CHECK(log.has_line("its controller cannot do 123456 bit/s"));
  CHECK(log.has_line("up, error-active, 250000 bit/s"));
  CHECK(is_up(adapter.interface_name()));
}

TEST_CASE("an adapter that is unplugged repeatedly leaves neither watcher nor reader behind",
          "[can_tier2_slcan]") {
  const auto source = drivers::open_socketcan({.interface_name = "can0", .wait_for_interface = true});
  REQUIRE(source.ok());
  ControllerLog log({.interface_name = "can0", .bitrate = 500000, .restart_ms = 0});
  CHECK(log.has_line("gone; waiting for it"));
  for (std::size_t round = 1; round <= 10; ++round) {
    const SlcanAdapter adapter;
    REQUIRE(adapter.interface_name() == "can0");
    // Frames arrive before the watcher has read the state that it set.
    CHECK(log.has_line("set to 500000 bit/s and started", round));
    CHECK(eventually([&] {
      adapter.say("t1230");
      return !read_frames(**source, 1, 0.05).empty();
    }));
  }
  CHECK(eventually([&] { return log.status().state == CanBusState::kGone; }));
  CHECK(log.status().times_gone == 10);
}
