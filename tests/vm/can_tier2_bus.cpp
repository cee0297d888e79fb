#include "nilio/drivers/can/socketcan/socketcan.hpp"

#include "drivers/can/socketcan/can_interface.hpp"
#include "tests/vm/vm_support.hpp"

#include <ctime>
#include <linux/can/error.h>
#include <map>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::tests;
using Catch::Matchers::Contains;
using drivers::CanFrame;
using drivers::CanSendResult;

namespace {

std::unique_ptr<drivers::FrameSource> listen(const drivers::SocketCanConfig& config) {
  auto source = drivers::open_socketcan(config);
  INFO((source ? "" : source.error().message));
  REQUIRE(source.ok());
  return std::move(source).value();
}

std::int64_t realtime_ns() {
  timespec now{};
  clock_gettime(CLOCK_REALTIME, &now);
  return static_cast<std::int64_t>(now.tv_sec) * 1'000'000'000 + now.tv_nsec;
}

bool same(const CanFrame& a, const CanFrame& b) {
  return a.id == b.id && a.extended == b.extended && a.remote == b.remote && a.error == b.error &&
         a.flexible_data_rate == b.flexible_data_rate && a.length == b.length && a.data == b.data;
}

std::vector<CanFrame> numbered_frames(std::size_t count) {
  std::vector<CanFrame> frames;
  for (std::size_t i = 0; i < count; ++i)
    frames.push_back(data_frame(0x100 + static_cast<std::uint32_t>(i % 7),
                                {static_cast<std::uint8_t>(i), static_cast<std::uint8_t>(i >> 8U)}));
  return frames;
}

/// Reads until the source is bound to the new bus; earlier frames are lost.
void expect_frames_again(drivers::FrameSource& source) {
  REQUIRE(eventually([&] { return read_frames(source, 1, 0.0).empty() && has_listener("vcan0"); }));
  send_from_another_process("vcan0", numbered_frames(3));
  CHECK(read_frames(source, 3).size() == 3);
}

}  // namespace

TEST_CASE("frames of another process arrive once each, in order, unchanged and stamped by the kernel",
          "[can_tier2_bus]") {
  const VirtualBus bus("vcan0");
  const auto source = listen({.interface_name = "vcan0"});
  const auto sent = numbered_frames(1000);
  const std::int64_t before = realtime_ns();
  send_from_another_process("vcan0", sent);
  const auto received = read_frames(*source, sent.size());
  const std::int64_t after = realtime_ns();
  REQUIRE(received.size() == sent.size());
  std::int64_t last = before;
  for (std::size_t i = 0; i < sent.size(); ++i) {
    CHECK(same(received[i], sent[i]));
    CHECK(received[i].stamp.ns >= last);
    last = received[i].stamp.ns;
  }
  CHECK(last <= after);
  CHECK(read_frames(*source, 1, 0.2).empty());
  CHECK(source->stats().delivered == 1000);
  CHECK(source->stats().kernel_dropped == 0);
  CHECK(source->stats().malformed == 0);
}

TEST_CASE("extended, remote, empty and CAN FD frames keep their kind over the bus", "[can_tier2_bus]") {
  const VirtualBus bus("vcan0");
  const auto source = listen({.interface_name = "vcan0"});
  CanFrame remote = data_frame(0x12, {});
  remote.remote = true;
  CanFrame flexible = data_frame(0x1ABCDEF0, std::vector<std::uint8_t>(64, 0xA5));
  flexible.flexible_data_rate = true;
  CanFrame short_flexible = data_frame(0x55, {1, 2, 3});
  short_flexible.flexible_data_rate = true;
  const std::vector<CanFrame> sent{data_frame(0x7FF, {1, 2, 3, 4, 5, 6, 7, 8}),
                                   data_frame(0x1FFFFFFF, {9}),
                                   data_frame(0, {}),
                                   remote,
                                   flexible,
                                   short_flexible};
  send_from_another_process("vcan0", sent);
  const auto received = read_frames(*source, sent.size());
  REQUIRE(received.size() == sent.size());
  for (std::size_t i = 0; i < sent.size(); ++i) CHECK(same(received[i], sent[i]));
}

TEST_CASE("a classic bus rejects CAN FD frames and continues with classic ones", "[can_tier2_bus]") {
  const VirtualBus bus("vcan0", 16);
  const auto source = listen({.interface_name = "vcan0"});
  auto sender = drivers::CanSender::open("vcan0");
  REQUIRE(sender.ok());
  CanFrame flexible = data_frame(0x10, std::vector<std::uint8_t>(12));
  flexible.flexible_data_rate = true;
  CHECK(sender->send(flexible) == CanSendResult::kRefused);
  CHECK(sender->send(data_frame(0x11, {1})) == CanSendResult::kSent);
  const auto received = read_frames(*source, 1);
  REQUIRE(received.size() == 1);
  CHECK(received[0].id == 0x11);
}

TEST_CASE("filters let their identifiers through, standard and extended apart, and error frames always",
          "[can_tier2_bus]") {
  const VirtualBus bus("vcan0");
  const auto one = listen({.interface_name = "vcan0", .filters = {{.id = 0x32}}});
  const auto group =
      listen({.interface_name = "vcan0",
              .filters = {{.id = 0x30, .extended = false, .mask = 0x7F0}, {.id = 0x32, .extended = true}}});
  std::vector<CanFrame> sent;
  for (const std::uint32_t id : {0x31U, 0x32U, 0x33U, 0x41U, 0x7FFU}) sent.push_back(data_frame(id, {1}));
  sent.push_back(data_frame(0x32, {2}));
  sent.back().extended = true;
  sent.push_back(data_frame(0x10032, {3}));
  send_from_another_process("vcan0", sent);
  send_error_frame("vcan0", CAN_ERR_BUSOFF);

  const auto of_one = read_frames(*one, 2);
  REQUIRE(of_one.size() == 2);
  CHECK(same(of_one[0], sent[1]));
  CHECK(of_one[1].error);
  CHECK(read_frames(*one, 1, 0.1).empty());
  const auto of_group = read_frames(*group, 5);
  REQUIRE(of_group.size() == 5);
  for (std::size_t i = 0; i < 3; ++i) CHECK(same(of_group[i], sent[i]));
  CHECK(same(of_group[3], sent[5]));
  CHECK(of_group[4].error);
}

TEST_CASE("error frames carry their class and are counted in the status", "[can_tier2_bus]") {
  const VirtualBus bus("vcan0");
  const auto source = listen({.interface_name = "vcan0"});
  send_error_frame("vcan0", CAN_ERR_CRTL, {0, CAN_ERR_CRTL_RX_WARNING, 0, 0, 0, 0, 100, 100});
  send_error_frame("vcan0", CAN_ERR_BUSOFF);
  send_error_frame("vcan0", CAN_ERR_RESTARTED);
  const auto received = read_frames(*source, 3);
  REQUIRE(received.size() == 3);
  const std::array<std::uint32_t, 3> classes{CAN_ERR_CRTL, CAN_ERR_BUSOFF, CAN_ERR_RESTARTED};
  for (std::size_t i = 0; i < classes.size(); ++i) {
    CHECK(received[i].error);
    CHECK(received[i].id == classes[i]);
  }
  CHECK(received[0].data[1] == CAN_ERR_CRTL_RX_WARNING);
  CHECK_THAT(source->status(), Contains("3 of them error frames") && Contains("1 times bus-off"));
}

TEST_CASE("a program does not receive the frames it sends on the same socket, and others receive them once",
          "[can_tier2_bus]") {
  const VirtualBus bus("vcan0");
  const auto first = listen({.interface_name = "vcan0"});
  const auto second = listen({.interface_name = "vcan0"});
  auto sender = drivers::CanSender::open("vcan0");
  REQUIRE(sender.ok());
  for (const CanFrame& frame : numbered_frames(50)) REQUIRE(sender->send(frame) == CanSendResult::kSent);
  for (const auto* source : {&first, &second}) {
    CHECK(read_frames(**source, 50).size() == 50);
    CHECK(read_frames(**source, 1, 0.1).empty());
  }
}

TEST_CASE("frames lost in a full receive buffer are counted exactly by the kernel's counter",
          "[can_tier2_bus]") {
  const VirtualBus bus("vcan0");
  const auto source = listen({.interface_name = "vcan0", .receive_buffer_bytes = 8192});
  send_from_another_process("vcan0", numbered_frames(500));
  REQUIRE(eventually([] { return kernel_count("vcan0", "rx_packets") == 500; }));
  const std::size_t kept = read_waiting(*source).size();
  CHECK(kept > 0);
  CHECK(kept < 100);
  // The next received frame carries the count.
  send_from_another_process("vcan0", numbered_frames(1));
  CHECK(read_frames(*source, 1).size() == 1);
  CHECK(source->stats().kernel_dropped == 500 - kept);
  CHECK(source->stats().delivered == kept + 1);
}

TEST_CASE("the source waits for an interface that is down, and delivers its frames when it is up again",
          "[can_tier2_bus]") {
  const VirtualBus bus("vcan0");
  const auto source = listen({.interface_name = "vcan0"});
  auto sender = drivers::CanSender::open("vcan0");
  REQUIRE(sender.ok());
  set_up("vcan0", false);
  CHECK(sender->send(data_frame(1, {})) == CanSendResult::kDown);
  CHECK(read_frames(*source, 1, 0.5).empty());
  CHECK_THAT(source->status(), Contains("down") && Contains("ip link set vcan0 up"));
  set_up("vcan0", true);
  CHECK(sender->send(data_frame(2, {})) == CanSendResult::kSent);
  const auto received = read_frames(*source, 1);
  REQUIRE(received.size() == 1);
  CHECK(received[0].id == 2);
  CHECK_THAT(source->status(), Contains("1 times down or gone"));
}

TEST_CASE("an unplugged interface is reported as gone, and opened again under its new number",
          "[can_tier2_bus]") {
  VirtualBus bus("vcan0");
  const auto source = listen({.interface_name = "vcan0"});
  send_from_another_process("vcan0", numbered_frames(3));
  CHECK(read_frames(*source, 3).size() == 3);
  for (std::uint64_t round = 1; round <= 3; ++round) {
    bus.remove();
    CHECK(read_frames(*source, 1, 0.3).empty());
    CHECK_THAT(source->status(), Contains("gone; waiting for it"));
    bus.add();
    expect_frames_again(*source);
  }
}

TEST_CASE("a bus replaced while no thread was reading is detected", "[can_tier2_bus]") {
  VirtualBus bus("vcan0");
  const auto source = listen({.interface_name = "vcan0"});
  bus.remove();
  bus.add();
  expect_frames_again(*source);
}

TEST_CASE("a virtual bus has no controller, and the query returns at once", "[can_tier2_bus]") {
  const VirtualBus bus("vcan0");
  const auto state = drivers::query_can_interface("vcan0");
  CHECK(state.present);
  CHECK(state.up);
  CHECK_FALSE(state.silent);
  CHECK_FALSE(state.controller);
}

TEST_CASE("an interface that is not CAN is rejected on a kernel with CAN", "[can_tier2_bus]") {
  const auto source = drivers::open_socketcan({.interface_name = "lo"});
  REQUIRE_FALSE(source.ok());
  CHECK_THAT(source.error().message, Contains("lo: is no CAN interface"));
  CHECK(is_up("lo"));
}
