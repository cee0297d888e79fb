#include "tests/vm/vm_support.hpp"

#include "nilio/drivers/can/socketcan/socketcan.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iostream>
#include <iterator>
#include <linux/can.h>
#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <regex>
#include <sstream>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>
#include <utility>

#include <catch2/catch.hpp>

namespace nilio::tests {

namespace {

using drivers::CanFrame;

/// Longer than one check in a running guest.
constexpr std::chrono::duration<double> kLongestLook(0.25);
/// On an emulated processor a look at the service takes longer than what it waits for: the pause behind it
/// lasts so many looks.
constexpr double kPauseLooks = 4.0;
constexpr std::chrono::duration<double> kShortestPause(0.005);
constexpr std::chrono::duration<double> kLongestPause(1.0);

/// Flags of an interface by SIOCGIFFLAGS; 0 for a missing one.
short interface_flags(int descriptor, const std::string& name, ifreq& request) {
  std::strncpy(request.ifr_name, name.c_str(), IFNAMSIZ - 1);
  return ioctl(descriptor, SIOCGIFFLAGS, &request) == 0 ? request.ifr_flags : short{0};
}

}  // namespace

bool eventually(const std::function<bool()>& condition, double seconds) {
  using Seconds = std::chrono::duration<double>;
  Seconds patience(seconds);
  auto before = std::chrono::steady_clock::now();
  while (!condition()) {
    if (patience <= Seconds(0.0)) return false;
    const Seconds look = std::chrono::steady_clock::now() - before;
    const Seconds pause = std::clamp(Seconds(kPauseLooks * look), kShortestPause, kLongestPause);
    std::this_thread::sleep_for(pause);
    const auto now = std::chrono::steady_clock::now();
    // A slow look shows how slowly the guest runs, and a long pause that it did not.
    const double rate = std::min(1.0, kLongestLook / look);
    patience -= std::min(rate * Seconds(now - before), kLongestLook + pause);
    before = now;
  }
  return true;
}

void say_undecided(const std::string& what) {
  std::cout << "undecided: " << what << ", for the guest was kept waiting; run it again on a quieter machine"
            << std::endl;
}

std::size_t count_lines(const std::string& text, const std::string& pattern) {
  const std::regex expression(pattern);
  std::istringstream lines(text);
  std::size_t count = 0;
  for (std::string line; std::getline(lines, line);)
    if (std::regex_search(line, expression)) ++count;
  return count;
}

int shell(const std::string& command) {
  const int status = std::system(command.c_str());
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

VirtualBus::VirtualBus(std::string name, int mtu) : name_(std::move(name)), mtu_(mtu) { add(); }

VirtualBus::~VirtualBus() {
  if (if_nametoindex(name_.c_str()) != 0) shell("busybox ip link delete " + name_);
}

void VirtualBus::remove() { REQUIRE(shell("busybox ip link delete " + name_) == 0); }

void VirtualBus::add() {
  REQUIRE(shell("busybox ip link add dev " + name_ + " type vcan && busybox ip link set " + name_ + " mtu " +
                std::to_string(mtu_) + " up") == 0);
}

void set_up(const std::string& interface_name, bool up) {
  const int descriptor = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  ifreq request{};
  const short flags = interface_flags(descriptor, interface_name, request);
  request.ifr_flags = static_cast<short>(up ? flags | IFF_UP : flags & ~IFF_UP);
  const bool done = ioctl(descriptor, SIOCSIFFLAGS, &request) == 0;
  close(descriptor);
  REQUIRE(done);
}

bool is_up(const std::string& interface_name) {
  const int descriptor = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  ifreq request{};
  const short flags = interface_flags(descriptor, interface_name, request);
  close(descriptor);
  return (flags & IFF_UP) != 0;
}

std::uint64_t kernel_count(const std::string& interface_name, const std::string& counter) {
  std::ifstream file("/sys/class/net/" + interface_name + "/statistics/" + counter);
  std::uint64_t count = 0;
  file >> count;
  REQUIRE(file);
  return count;
}

bool has_listener(const std::string& interface_name) {
  // Sockets for error frames, one per source; "(vcan0: no entry)" without any.
  std::ifstream file("/proc/net/can/rcvlist_err");
  std::string word;
  while (file >> word)
    if (word == interface_name) return true;
  return false;
}

CanFrame data_frame(std::uint32_t id, std::vector<std::uint8_t> data) {
  CanFrame frame;
  frame.id = id;
  frame.extended = id > CAN_SFF_MASK;
  frame.length = static_cast<std::uint8_t>(data.size());
  std::copy(data.begin(), data.end(), frame.data.begin());
  return frame;
}

void send_error_frame(const std::string& interface_name, std::uint32_t error_class,
                      std::vector<std::uint8_t> data) {
  const int descriptor = socket(PF_CAN, SOCK_RAW | SOCK_CLOEXEC, CAN_RAW);
  sockaddr_can address{};
  address.can_family = AF_CAN;
  address.can_ifindex = static_cast<int>(if_nametoindex(interface_name.c_str()));
  can_frame frame{};
  frame.can_id = CAN_ERR_FLAG | error_class;
  frame.len = CAN_ERR_DLC;
  std::copy_n(data.begin(), std::min<std::size_t>(data.size(), CAN_ERR_DLC), frame.data);
  const bool sent = bind(descriptor, reinterpret_cast<const sockaddr*>(&address), sizeof(address)) == 0 &&
                    write(descriptor, &frame, sizeof(frame)) == sizeof(frame);
  close(descriptor);
  REQUIRE(sent);
}

std::vector<CanFrame> read_frames(drivers::FrameSource& source, std::size_t count, double seconds) {
  std::vector<CanFrame> frames;
  std::array<CanFrame, 64> slots;
  eventually(
      [&] {
        const auto wanted = std::min(slots.size(), count - frames.size());
        const auto read =
            source.read(std::span(slots).first(wanted), core::Duration::from_milliseconds(20.0));
        frames.insert(frames.end(), slots.begin(), slots.begin() + static_cast<std::ptrdiff_t>(read.count));
        return frames.size() >= count;
      },
      seconds);
  return frames;
}

std::vector<CanFrame> read_waiting(drivers::FrameSource& source) {
  std::vector<CanFrame> frames;
  std::array<CanFrame, 64> slots;
  for (;;) {
    const auto read = source.read(slots, core::Duration{0});
    if (read.count == 0) return frames;
    frames.insert(frames.end(), slots.begin(), slots.begin() + static_cast<std::ptrdiff_t>(read.count));
  }
}

void send_from_another_process(const std::string& interface_name, const std::vector<CanFrame>& frames) {
  const pid_t child = fork();
  if (child == 0) {
    auto sender = drivers::CanSender::open(interface_name);
    if (!sender) _exit(2);
    for (const CanFrame& frame : frames) {
      drivers::CanSendResult result = sender->send(frame);
      for (int i = 0; i < 5000 && result == drivers::CanSendResult::kQueueFull; ++i) {
        usleep(1000);
        result = sender->send(frame);
      }
      if (result != drivers::CanSendResult::kSent) _exit(1);
    }
    _exit(0);
  }
  int status = -1;
  waitpid(child, &status, 0);
  REQUIRE(status == 0);
}

Program::Program(std::vector<std::string> words, std::filesystem::path log) : log_(std::move(log)) {
  std::vector<char*> argv;
  for (std::string& word : words) argv.push_back(word.data());
  argv.push_back(nullptr);
  pid_ = fork();
  if (pid_ != 0) return;
  if (freopen(log_.c_str(), "w", stdout) == nullptr || dup2(STDOUT_FILENO, STDERR_FILENO) < 0) _exit(126);
  execv(argv[0], argv.data());
  _exit(127);
}

Program::~Program() {
  if (pid_ > 0) stop(SIGKILL);
}

std::string Program::output() const {
  std::ifstream file(log_, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

bool Program::has_line(const std::string& pattern, std::size_t times) const {
  return eventually([&] { return count(pattern) >= times; });
}

std::size_t Program::count(const std::string& pattern) const { return count_lines(output(), pattern); }

int Program::stop(int signal) {
  kill(pid_, signal);
  return wait();
}

int Program::wait() {
  int status = 0;
  waitpid(std::exchange(pid_, -1), &status, 0);
  return WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
}

}  // namespace nilio::tests
