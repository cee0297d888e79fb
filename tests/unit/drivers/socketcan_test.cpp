#include "nilio/drivers/can/socketcan/socketcan.hpp"

#include "drivers/can/socketcan/can_interface.hpp"
#include "drivers/can/socketcan/can_socket.hpp"

#include <cerrno>
#include <linux/can/netlink.h>
#include <linux/can/raw.h>
#include <sys/socket.h>
#include <unistd.h>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::drivers;
using Catch::Matchers::Contains;

namespace {

CanFrame frame_of(std::uint32_t id, bool extended, std::uint8_t length) {
  CanFrame frame;
  frame.id = id;
  frame.extended = extended;
  frame.length = length;
  for (std::uint8_t i = 0; i < length; ++i) frame.data[i] = static_cast<std::uint8_t>(i + 1);
  return frame;
}

bool kernel_has_can() {
  const int descriptor = socket(PF_CAN, SOCK_RAW, CAN_RAW);
  if (descriptor >= 0) close(descriptor);
  return descriptor >= 0;
}

}  // namespace

TEST_CASE("frames to the kernel and back keep identifier, kind, length and data", "[socketcan]") {
  CanFrame remote = frame_of(0x12, false, 0);
  remote.remote = true;
  CanFrame flexible = frame_of(0x1ABCDEF0, true, 64);
  flexible.flexible_data_rate = true;
  for (const CanFrame& frame : {frame_of(0x7FF, false, 8), frame_of(0x1FFFFFFF, true, 3),
                                frame_of(0x34, false, 0), remote, flexible}) {
    const auto kernel = to_kernel_frame(frame);
    REQUIRE(kernel);
    CHECK(kernel->size == (frame.flexible_data_rate ? CANFD_MTU : CAN_MTU));
    const auto back = from_kernel_frame(kernel->frame, kernel->size);
    REQUIRE(back);
    CHECK(back->id == frame.id);
    CHECK(back->extended == frame.extended);
    CHECK(back->remote == frame.remote);
    CHECK_FALSE(back->error);
    CHECK(back->flexible_data_rate == frame.flexible_data_rate);
    CHECK(back->length == frame.length);
    CHECK(back->data == frame.data);
  }
}

TEST_CASE("an error frame of the controller keeps its class bits and is not a data frame", "[socketcan]") {
  canfd_frame kernel{};
  kernel.can_id = CAN_ERR_FLAG | 0x40U;
  kernel.len = 8;
  const auto frame = from_kernel_frame(kernel, CAN_MTU);
  REQUIRE(frame);
  CHECK(frame->error);
  CHECK(frame->id == 0x40);
  CHECK_FALSE(frame->extended);
  CHECK_FALSE(to_kernel_frame(*frame));
}

TEST_CASE("invalid frames are neither accepted from the kernel nor sent to it", "[socketcan]") {
  canfd_frame kernel{};
  kernel.len = 9;
  CHECK_FALSE(from_kernel_frame(kernel, CAN_MTU));
  CHECK(from_kernel_frame(kernel, CANFD_MTU));
  kernel.len = 65;
  CHECK_FALSE(from_kernel_frame(kernel, CANFD_MTU));
  kernel.len = 0;
  CHECK_FALSE(from_kernel_frame(kernel, 12));
  CHECK_FALSE(to_kernel_frame(frame_of(0x800, false, 1)));
  CHECK_FALSE(to_kernel_frame(frame_of(0x20000000, true, 1)));
  CHECK_FALSE(to_kernel_frame(frame_of(0x1, false, 9)));
}

TEST_CASE("the error for an unusable CAN interface names the command that helps", "[socketcan]") {
  const auto source = open_socketcan({.interface_name = "nilio_none0"});
  const auto sender = CanSender::open("nilio_none0");
  REQUIRE_FALSE(source.ok());
  REQUIRE_FALSE(sender.ok());
  for (const std::string& message : {source.error().message, sender.error().message}) {
    CHECK_THAT(message, Contains("nilio_none0"));
    if (kernel_has_can()) {
      CHECK_THAT(message, Contains("no such interface") && Contains("ip link show type can"));
    } else {
      CHECK_THAT(message, Contains("modprobe can") && Contains("modprobe can_raw"));
    }
  }
  for (const char* name : {"", "a-name-that-is-too-long"}) {
    const auto broken = open_socketcan({.interface_name = name});
    REQUIRE_FALSE(broken.ok());
    CHECK_THAT(broken.error().message, Contains("is no interface name"));
  }
}

TEST_CASE("an interface that is not CAN is rejected, because it could be taken down by mistake",
          "[socketcan]") {
  if (!kernel_has_can()) {
    WARN("skipped: this kernel has no CAN sockets");
    return;
  }
  const auto source = open_socketcan({.interface_name = "lo"});
  REQUIRE_FALSE(source.ok());
  CHECK_THAT(source.error().message, Contains("lo: is no CAN interface"));
}

TEST_CASE("the state of a CAN interface is described with the remedy", "[socketcan]") {
  const auto describe = [](bool up, std::optional<int> controller) {
    CanInterfaceState state{
        .present = true, .up = up, .silent = false, .controller = controller, .bitrate = {}};
    if (controller) state.bitrate = 500000;
    return describe_can_interface("can0", state);
  };
  CHECK(describe(true, CAN_STATE_ERROR_ACTIVE) == "up, error-active, 500000 bit/s");
  CHECK(describe(true, std::nullopt) == "up");
  CHECK_THAT(describe(true, CAN_STATE_BUS_OFF), Contains("ip link set can0 type can restart"));
  CHECK_THAT(describe(true, CAN_STATE_ERROR_PASSIVE), Contains("120 ohm"));
  CHECK_THAT(describe(false, std::nullopt), Contains("ip link set can0 up type can bitrate 500000"));
  CHECK_THAT(describe_can_interface("can0", {}), Contains("gone"));
  CHECK_FALSE(query_can_interface("nilio_none0").present);
}
