#include "nilio/drivers/can/can_controller.hpp"
#include "nilio/drivers/can/socketcan/socketcan.hpp"

#include "drivers/can/socketcan/can_interface.hpp"
#include "tests/vm/controller_log.hpp"
#include "tests/vm/emulated_controllers.hpp"
#include "tests/vm/vm_support.hpp"

#include <filesystem>
#include <iterator>
#include <linux/can/error.h>
#include <linux/can/netlink.h>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::tests;
using Catch::Matchers::Contains;
using drivers::CanBusState;

namespace {

std::unique_ptr<drivers::FrameSource> listen(const drivers::SocketCanConfig& config) {
  auto source = drivers::open_socketcan(config);
  REQUIRE(source.ok());
  return std::move(source).value();
}

std::vector<drivers::CanFrame> numbered_frames(std::size_t count) {
  std::vector<drivers::CanFrame> frames;
  for (std::size_t i = 0; i < count; ++i)
    frames.push_back(data_frame(0x200 + static_cast<std::uint32_t>(i % 5),
                                {static_cast<std::uint8_t>(i), static_cast<std::uint8_t>(i >> 8U)}));
  return frames;
}

}  // namespace

TEST_CASE(
    "controllers are set to the requested bit rate, started, and transmit frames to each other in order",
    "[can_tier3_controllers]") {
  reset_controllers();
  ControllerLog first({.interface_name = "can0", .bitrate = 500000, .restart_ms = 0});
  ControllerLog second({.interface_name = "can1", .bitrate = 500000, .restart_ms = 100});
  for (ControllerLog* log : {&first, &second}) {
    CHECK(log->has_line("set to 500000 bit/s and started"));
    CHECK(log->has_line("up, error-active, 500000 bit/s"));
  }
  CHECK(drivers::query_can_interface("can0").restart_ms == 0U);
  CHECK(drivers::query_can_interface("can1").restart_ms == 100U);

  const auto source = listen({.interface_name = "can1"});
  auto sent = numbered_frames(400);
  sent.push_back(data_frame(0x1ABCDEF0, {1, 2, 3, 4, 5, 6, 7, 8}));
  send_from_another_process("can0", sent);
  const auto received = read_frames(*source, sent.size());
  REQUIRE(received.size() == sent.size());
  for (std::size_t i = 0; i < sent.size(); ++i) {
    CHECK(received[i].id == sent[i].id);
    CHECK(received[i].extended == sent[i].extended);
    CHECK(received[i].data == sent[i].data);
    if (i > 0) CHECK(received[i].stamp >= received[i - 1].stamp);
  }
  CHECK(source->stats().kernel_dropped == 0);
}

TEST_CASE("a controller rejects a bit rate that its clock cannot generate, and keeps its old one",
          "[can_tier3_controllers]") {
  reset_controllers();
  drivers::set_up_can_interface("can0", 250000, 0);
  ControllerLog log({.interface_name = "can0", .bitrate = 1000, .restart_ms = 0});
  CHECK(log.has_line("its controller cannot do 1000 bit/s"));
  CHECK(log.has_line("up, error-active, 250000 bit/s"));
}

TEST_CASE("frames lost in a full buffer are counted exactly", "[can_tier3_controllers]") {
  reset_controllers();
  drivers::set_up_can_interface("can0", 500000, 0);
  drivers::set_up_can_interface("can1", 500000, 0);
  const auto source = listen({.interface_name = "can1", .receive_buffer_bytes = 8192});
  const std::uint64_t before = kernel_count("can1", "rx_packets");
  send_from_another_process("can0", numbered_frames(200));
  REQUIRE(eventually([&] { return kernel_count("can1", "rx_packets") == before + 200; }));
  const std::size_t kept = read_waiting(*source).size();
  CHECK(kept > 0);
  CHECK(kept < 100);
  send_from_another_process("can0", numbered_frames(1));
  CHECK(read_frames(*source, 1).size() == 1);
  CHECK(source->stats().kernel_dropped == 200 - kept);
}

TEST_CASE("switching an interface off and on is reported; the watcher does not switch it on",
          "[can_tier3_controllers]") {
  reset_controllers();
  ControllerLog log({.interface_name = "can1", .bitrate = 500000, .restart_ms = 0});
  REQUIRE(log.has_line("up, error-active"));
  drivers::set_up_can_interface("can0", 500000, 0);
  const auto source = listen({.interface_name = "can1"});
  set_up("can1", false);
  CHECK(log.has_line("CAN can1: down; set it up"));
  CHECK(read_frames(*source, 1, 0.5).empty());
  CHECK_FALSE(is_up("can1"));
  set_up("can1", true);
  CHECK(log.has_line("up, error-active", 2));
  send_from_another_process("can0", numbered_frames(3));
  CHECK(read_frames(*source, 3).size() == 3);
  CHECK(log.status().times_down == 1);
}

TEST_CASE("injected errors reach sockets and log, and bus-off ends by a restart of nilio",
          "[can_tier3_controllers]") {
  reset_controllers();
  drivers::set_up_can_interface("can0", 500000, 0);
  ControllerLog log({.interface_name = "can1", .bitrate = 500000, .restart_ms = 0});
  REQUIRE(log.has_line("up, error-active"));
  const auto source = listen({.interface_name = "can1"});
  inject("can1 warning");
  CHECK(log.has_line("error-warning: there are errors on the bus"));
  inject("can1 passive");
  CHECK(log.has_line("error-passive: there are errors on the bus"));
  inject("can1 bus-off");
  CHECK(log.has_line("bus-off: the controller has given up"));
  CHECK(log.has_line("up, error-active, 500000 bit/s again after once bus-off, restarted once by nilio"));
  std::uint32_t classes = 0;
  for (const auto& frame : read_frames(*source, 4)) {
    CHECK(frame.error);
    classes |= frame.id;
  }
  CHECK((classes & CAN_ERR_CRTL) != 0);
  CHECK((classes & CAN_ERR_BUSOFF) != 0);
  CHECK((classes & CAN_ERR_RESTARTED) != 0);
  CHECK(is_up("can1"));
  send_from_another_process("can0", numbered_frames(3));
  CHECK(read_frames(*source, 3).size() == 3);
  CHECK(log.status().bus_offs == 1);
  CHECK(log.status().restarts == 1);
  CHECK_THAT(source->status(), Contains("1 times bus-off"));
}

TEST_CASE("a controller that is repeatedly bus-off is restarted after waits that double",
          "[can_tier3_controllers]") {
  reset_controllers();
  ControllerLog log({.interface_name = "can1", .bitrate = 500000, .restart_ms = 0});
  REQUIRE(log.has_line("up, error-active"));
  const auto source = listen({.interface_name = "can1"});
  core::Duration wait = core::Duration::from_milliseconds(100.0);
  core::Time restarted;
  for (std::uint64_t round = 1; round <= 4; ++round) {
    inject("can1 bus-off");
    const auto frames = read_frames(*source, 2);
    REQUIRE(frames.size() == 2);
    REQUIRE((frames[0].id & CAN_ERR_BUSOFF) != 0);
    REQUIRE((frames[1].id & CAN_ERR_RESTARTED) != 0);
    // After 10 s without bus-off the waits begin short again.
    if (round > 1 && (frames[0].stamp - restarted).seconds() > 9.0)
      return say_undecided("whether waits after bus-off double");
    restarted = frames[1].stamp;
    // The kernel's stamps use another clock than the waits.
    CHECK((restarted - frames[0].stamp).seconds() > 0.95 * wait.seconds());
    // A bus-off before the watcher's next reading would look like a restart without effect.
    REQUIRE(eventually([&] { return log.status().state == CanBusState::kErrorActive; }));
    CHECK(log.status().restarts == round);
    wait.ns *= 2;
  }
  CHECK(log.has_line("error-active, 500000 bit/s again after .* bus-off, restarted .* by nilio"));
  CHECK(log.status().bus_offs == 4);
}

TEST_CASE("a controller with automatic restart is not restarted by nilio, and short bus-offs are counted",
          "[can_tier3_controllers]") {
  reset_controllers();
  drivers::set_up_can_interface("can0", 500000, 0);
  ControllerLog log({.interface_name = "can1", .bitrate = 500000, .restart_ms = 10});
  REQUIRE(log.has_line("up, error-active"));
  for (std::uint64_t round = 1; round <= 3; ++round) {
    inject("can1 bus-off");
    CHECK(eventually([&] { return log.status().bus_offs == round; }));
    CHECK(eventually(
        [&] { return drivers::query_can_interface("can1").controller == CAN_STATE_ERROR_ACTIVE; }));
  }
  CHECK(log.has_line("was bus-off|restarts itself after 10 ms"));
  CHECK(log.status().restarts == 0);
}

TEST_CASE("interfaces that vanish with their driver are set up and read again when they return",
          "[can_tier3_controllers]") {
  reset_controllers();
  ControllerLog first({.interface_name = "can0", .bitrate = 500000, .restart_ms = 0});
  ControllerLog second({.interface_name = "can1", .bitrate = 500000, .restart_ms = 0});
  REQUIRE(first.has_line("up, error-active"));
  REQUIRE(second.has_line("up, error-active"));
  const auto source = listen({.interface_name = "can1"});
  unplug_controllers();
  CHECK(second.has_line("gone; waiting for it"));
  CHECK(read_frames(*source, 1, 0.3).empty());
  CHECK_THAT(source->status(), Contains("gone"));
  plug_in_controllers();
  CHECK(first.has_line("up, error-active", 2));
  CHECK(second.has_line("set to 500000 bit/s and started", 2));
  CHECK(second.has_line("up, error-active", 2));
  REQUIRE(eventually([&] { return read_frames(*source, 1, 0.0).empty() && has_listener("can1"); }));
  send_from_another_process("can0", numbered_frames(3));
  CHECK(read_frames(*source, 3).size() == 3);
  CHECK(second.status().times_gone == 1);
}

TEST_CASE("the watcher of a controller ends as soon as it is released", "[can_tier3_controllers]") {
  reset_controllers();
  const auto entries = [](const std::string& folder) {
    return std::distance(std::filesystem::directory_iterator("/proc/self/" + folder), {});
  };
  const auto threads = entries("task");
  const auto descriptors = entries("fd");
  for (int i = 0; i < 20; ++i) ControllerLog log({.interface_name = "can0"});
  // A thread starved for longer than its watcher waits ends slightly later.
  CHECK(eventually([&] { return entries("task") == threads && entries("fd") == descriptors; }));
}
