#include "tests/vm/slcan_adapter.hpp"

#include <array>
#include <cstdlib>
#include <fcntl.h>
#include <linux/tty.h>
#include <net/if.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <termios.h>
#include <unistd.h>

#include <catch2/catch.hpp>

namespace nilio::tests {

namespace {

void make_raw(int descriptor) {
  termios settings{};
  REQUIRE(tcgetattr(descriptor, &settings) == 0);
  cfmakeraw(&settings);
  REQUIRE(tcsetattr(descriptor, TCSANOW, &settings) == 0);
}

}  // namespace

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
  heard_.append(bytes.data(), static_cast<std::size_t>(size));
}

void SlcanAdapter::say(const std::string& line) const {
  const std::string whole = line + '\r';
  REQUIRE(write(master_, whole.data(), whole.size()) == static_cast<ssize_t>(whole.size()));
}

std::string SlcanAdapter::received() const {
  const std::lock_guard lock(mutex_);
  return heard_;
}

}  // namespace nilio::tests
