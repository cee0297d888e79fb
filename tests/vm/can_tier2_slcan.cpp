#include "nilio/drivers/can/can_controller.hpp"
#include "nilio/drivers/can/socketcan/socketcan.hpp"

#include "drivers/can/socketcan/can_interface.hpp"
#include "tests/vm/controller_log.hpp"
#include "tests/vm/vm_support.hpp"

#include <array>
#include <cstdlib>
#include <fcntl.h>
#include <linux/can/error.h>
#include <linux/can/netlink.h>
#include <linux/tty.h>
#include <mutex>
#include <net/if.h>
#include <poll.h>
#include <string>
#include <sys/ioctl.h>
#include <termios.h>
#include <thread>
#include <unistd.h>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::tests;
using drivers::CanBusState;

namespace {

/// A serial CAN adapter for the kernel's slcan driver, at the other end of a pseudo-terminal. Keeps the
/// driver's lines; the test sends the adapter's lines, errors included. The destructor removes the interface.
class SlcanAdapter {
 public:
  SlcanAdapter();
  SlcanAdapter(const SlcanAdapter&) = delete;
  SlcanAdapter& operator=(const SlcanAdapter&) = delete;
  ~SlcanAdapter();

  [[nodiscard]] const std::string& interface_name() const { return name_; }
  /// Sends a line of the adapter, without line end: "t1232DEAD" a frame, "e1a" no acknowledgement, "sw057100"
  /// error-warning, "sp130140" error-passive, "sb000256" bus-off, "sa000000" error-active, with the counts
  /// sent and received.
  void send(const std::string& line) const;
  /// All lines of the driver: "S6" 500 kbit/s, "O" open, "C" close, "t..." frames to send.
  [[nodiscard]] std::string received() const;

 private:
  void listen();

  int master_ = -1;
  int slave_ = -1;
  std::string name_;
  mutable std::mutex mutex_;
  std::string received_;
  std::jthread listener_;
};

void make_raw(int descriptor) {
  termios settings{};
  REQUIRE(tcgetattr(descriptor, &settings) == 0);
  cfmakeraw(&settings);
  REQUIRE(tcsetattr(descriptor, TCSANOW, &settings) == 0);
}

SlcanAdapter::SlcanAdapter() : master_(posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC)) {
  REQUIRE(master_ >= 0);
  REQUIRE((grantpt(master_) == 0 && unlockpt(master_) == 0));
  slave_ = open(ptsname(master_), O_RDWR | O_NOCTTY | O_CLOEXEC);
  REQUIRE(slave_ >= 0);
  make_raw(slave_);
  const int discipline = N_SLCAN;
  REQUIRE(ioctl(slave_, TIOCSETD, &discipline) == 0);
  std::array<char, IFNAMSIZ> name{};
  REQUIRE(ioctl(slave_, SIOCGIFNAME, name.data()) == 0);
  name_ = name.data();
  listener_ = std::jthread([this](const std::stop_token& stop) {
    while (!stop.stop_requested()) listen();
  });
}

SlcanAdapter::~SlcanAdapter() {
  listener_.request_stop();
  listener_.join();
  close(slave_);
  close(master_);
}

void SlcanAdapter::listen() {
  pollfd waited{.fd = master_, .events = POLLIN, .revents = 0};
  if (poll(&waited, 1, 20) <= 0) return;
  std::array<char, 512> bytes{};
  const ssize_t size = read(master_, bytes.data(), bytes.size());
  if (size <= 0) return;
  const std::lock_guard lock(mutex_);
  received_.append(bytes.data(), static_cast<std::size_t>(size));
}

void SlcanAdapter::send(const std::string& line) const {
  const std::string whole = line + '\r';
  REQUIRE(write(master_, whole.data(), whole.size()) == static_cast<ssize_t>(whole.size()));
}

std::string SlcanAdapter::received() const {
  const std::lock_guard lock(mutex_);
  return received_;
}

}  // namespace

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
  adapter.send("t12321122");
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
  adapter.send("e1a");
  adapter.send("sw057100");
  CHECK(log.has_line("error-warning: there are errors on the bus"));
  adapter.send("sp130140");
  CHECK(log.has_line("error-passive: there are errors on the bus"));
  const auto frames = read_frames(**source, 3);
  REQUIRE(frames.size() == 3);
  for (const auto& frame : frames) CHECK(frame.error);
  CHECK((frames[0].id & CAN_ERR_ACK) != 0);
  CHECK((frames[1].id & CAN_ERR_CRTL) != 0);
  CHECK((frames[2].id & CAN_ERR_CRTL) != 0);
  CHECK(frames[2].data[1] != 0);
  adapter.send("sa000000");
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
    adapter.send("sb000256");
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
      adapter.send("t1230");
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
    adapter->send("t1230");
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
      adapter.send("t1230");
      return !read_frames(**source, 1, 0.05).empty();
    }));
  }
  CHECK(eventually([&] { return log.status().state == CanBusState::kGone; }));
  CHECK(log.status().times_gone == 10);
}
