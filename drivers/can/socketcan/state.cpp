#include "drivers/can/socketcan/state.hpp"

#include "drivers/can/can_link_query.hpp"

#include <chrono>
#include <condition_variable>
#include <cstdlib>
#include <cstring>
#include <linux/can/netlink.h>
#include <linux/ethtool.h>
#include <linux/sockios.h>
#include <memory>
#include <mutex>
#include <net/if.h>
#include <net/if_arp.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <thread>
#include <unistd.h>

namespace nilio::drivers {
namespace {

constexpr std::chrono::milliseconds kLongestQuery{300};

ifreq request_for(const std::string& name) {
  ifreq request{};
  std::strncpy(request.ifr_name, name.c_str(), IFNAMSIZ - 1);
  return request;
}

std::string driver_of(int descriptor, const std::string& name) {
  ethtool_drvinfo info{};
  info.cmd = ETHTOOL_GDRVINFO;
  ifreq request = request_for(name);
  request.ifr_data = reinterpret_cast<char*>(&info);
  if (ioctl(descriptor, SIOCETHTOOL, &request) != 0) return "";
  return {info.driver, strnlen(info.driver, sizeof(info.driver))};
}

/// What every interface answers at once. Nothing else is set when it is not there.
CanInterfaceState look_from_outside(const std::string& name) {
  CanInterfaceState state;
  const int descriptor = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (descriptor < 0) return state;
  ifreq flags = request_for(name);
  ifreq hardware = request_for(name);
  ifreq index = request_for(name);
  state.present = ioctl(descriptor, SIOCGIFFLAGS, &flags) == 0 &&
                  ioctl(descriptor, SIOCGIFHWADDR, &hardware) == 0 &&
                  ioctl(descriptor, SIOCGIFINDEX, &index) == 0;
  if (state.present) {
    state.up = (flags.ifr_flags & IFF_UP) != 0;
    state.is_can = hardware.ifr_hwaddr.sa_family == ARPHRD_CAN;
    state.index = static_cast<unsigned>(index.ifr_ifindex);
    state.driver = driver_of(descriptor, name);
  }
  ::close(descriptor);
  return state;
}

struct Answer {
  std::mutex mutex;
  std::condition_variable arrived;
  std::optional<CanInterfaceState> state;
};

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

bool runs_at(const CanInterfaceState& state, std::uint32_t bitrate) {
  const std::int64_t difference = static_cast<std::int64_t>(state.bitrate.value_or(0)) - bitrate;
  return std::abs(difference) * 20 <= bitrate;
}

CanInterfaceState look_at_can_interface(const std::string& name) {
  CanInterfaceState state = look_from_outside(name);
  if (state.is_can) ask_can_driver(state);
  return state;
}

/// The kernel answers one question at a time, and a driver in trouble can keep it busy: a thread of its own
/// asks and is left to itself when it takes longer. Thread and waiter share the answer.
CanInterfaceState query_can_interface(const std::string& name) {
  CanInterfaceState outside = look_from_outside(name);
  if (!outside.is_can) return outside;
  const auto answer = std::make_shared<Answer>();
  std::thread([name, answer] {
    const CanInterfaceState state = look_at_can_interface(name);
    const std::lock_guard lock(answer->mutex);
    answer->state = state;
    answer->arrived.notify_all();
  }).detach();
  std::unique_lock lock(answer->mutex);
  if (answer->arrived.wait_for(lock, kLongestQuery, [&] { return answer->state.has_value(); }))
    return *answer->state;
  outside.silent = true;
  return outside;
}

std::string describe_can_interface(const std::string& name, const CanInterfaceState& state) {
  if (!state.present) return "gone; waiting for it, check the adapter";
  if (!state.up) return "down; set it up with 'ip link set " + name + " up type can bitrate 500000'";
  if (state.silent) return "up, but its driver does not answer; check the adapter";
  std::string text = "up";
  if (state.controller) text += ", " + describe_controller(name, *state.controller);
  if (state.bitrate && *state.bitrate > 0) text += ", " + std::to_string(*state.bitrate) + " bit/s";
  return text;
}

}  // namespace nilio::drivers
