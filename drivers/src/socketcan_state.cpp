#include "socketcan_state.hpp"

#include <chrono>
#include <condition_variable>
#include <cstring>
#include <linux/ethtool.h>
#include <linux/sockios.h>
#include <memory>
#include <mutex>
#include <net/if.h>
#include <string_view>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <thread>
#include <unistd.h>

#include <libsocketcan.h>

namespace nilio::drivers {
namespace {

constexpr std::chrono::milliseconds kLongestQuery{300};

ifreq request_for(const std::string& name) {
  ifreq request{};
  std::strncpy(request.ifr_name, name.c_str(), IFNAMSIZ - 1);
  return request;
}

/// Virtual interfaces have no controller, and libsocketcan complains about them on standard error.
bool has_controller(int descriptor, const std::string& name) {
  ethtool_drvinfo info{};
  info.cmd = ETHTOOL_GDRVINFO;
  ifreq request = request_for(name);
  request.ifr_data = reinterpret_cast<char*>(&info);
  if (ioctl(descriptor, SIOCETHTOOL, &request) != 0) return true;
  const std::string_view driver(info.driver);
  return driver != "vcan" && driver != "vxcan";
}

struct Answer {
  std::mutex mutex;
  std::condition_variable arrived;
  bool complete = false;
  std::optional<int> controller;
  std::optional<std::uint32_t> bitrate;
};

void ask_driver(const std::string& name, Answer& answer) {
  int state = 0;
  can_bittiming timing{};
  const bool state_known = can_get_state(name.c_str(), &state) == 0;
  const bool timing_known = can_get_bittiming(name.c_str(), &timing) == 0;
  const std::lock_guard lock(answer.mutex);
  if (state_known) answer.controller = state;
  if (timing_known) answer.bitrate = timing.bitrate;
  answer.complete = true;
  answer.arrived.notify_all();
}

/// libsocketcan does not come back when the interface vanishes at the wrong moment, so a thread of its own
/// asks and is left behind then. Thread and waiter share the answer.
void query_controller(const std::string& name, CanInterfaceState& state) {
  const auto answer = std::make_shared<Answer>();
  std::thread([name, answer] { ask_driver(name, *answer); }).detach();
  std::unique_lock lock(answer->mutex);
  state.silent = !answer->arrived.wait_for(lock, kLongestQuery, [&] { return answer->complete; });
  state.controller = answer->controller;
  state.bitrate = answer->bitrate;
}

std::string describe_controller(const std::string& name, int controller) {
  switch (controller) {
    case CAN_STATE_ERROR_ACTIVE:
      return "error-active";
    case CAN_STATE_ERROR_WARNING:
      return "error-warning (errors on the bus; check bit rate, wiring and the 120 ohm at both ends)";
    case CAN_STATE_ERROR_PASSIVE:
      return "error-passive (many errors on the bus; check bit rate, wiring and the 120 ohm at both ends)";
    case CAN_STATE_BUS_OFF:
      return "bus-off (the controller has given up; check bit rate and wiring, then 'ip link set " + name +
             " type can restart', or let it restart by itself with 'restart-ms 100')";
    case CAN_STATE_STOPPED:
      return "stopped";
    case CAN_STATE_SLEEPING:
      return "sleeping";
    default:
      return "in an unknown state";
  }
}

}  // namespace

CanInterfaceState query_can_interface(const std::string& name) {
  CanInterfaceState state;
  const int descriptor = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (descriptor < 0) return state;
  ifreq request = request_for(name);
  state.present = ioctl(descriptor, SIOCGIFFLAGS, &request) == 0;
  state.up = state.present && (request.ifr_flags & IFF_UP) != 0;
  const bool ask = state.up && has_controller(descriptor, name);
  ::close(descriptor);
  if (ask) query_controller(name, state);
  return state;
}

std::string describe_can_interface(const std::string& name, const CanInterfaceState& state) {
  if (!state.present) return "gone; waiting for it, check the adapter";
  if (!state.up) return "down; set it up with 'ip link set " + name + " up type can bitrate 500000'";
  if (state.silent) return "up, but its driver does not answer; check the adapter";
  std::string text = "up";
  if (state.controller) text += ", " + describe_controller(name, *state.controller);
  if (state.bitrate) text += ", " + std::to_string(*state.bitrate) + " bit/s";
  return text;
}

}  // namespace nilio::drivers
