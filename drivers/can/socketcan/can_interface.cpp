#include "drivers/can/socketcan/can_interface.hpp"

#include "drivers/common/socket.hpp"

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <linux/can/netlink.h>
#include <linux/capability.h>
#include <linux/ethtool.h>
#include <linux/if_link.h>
#include <linux/rtnetlink.h>
#include <linux/sockios.h>
#include <memory>
#include <mutex>
#include <net/if.h>
#include <net/if_arp.h>
#include <span>
#include <string_view>
#include <sys/ioctl.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <thread>

#include <libsocketcan.h>

namespace nilio::drivers {
namespace {

using NetlinkBytes = std::span<const std::byte>;

constexpr std::chrono::milliseconds kLongestQuery{300};
constexpr timeval kLongestAnswer{.tv_sec = 0, .tv_usec = 300'000};

struct LinkRequest {
  nlmsghdr header{};
  ifinfomsg link{};
};

template <class Value>
std::optional<Value> value_of(NetlinkBytes bytes) {
  if (bytes.size() < sizeof(Value)) return std::nullopt;
  Value value{};
  std::memcpy(&value, bytes.data(), sizeof(Value));
  return value;
}

/// The attribute's content; empty when it is missing.
NetlinkBytes find_attribute(NetlinkBytes attributes, unsigned wanted) {
  while (const std::optional<rtattr> header = value_of<rtattr>(attributes)) {
    const std::size_t length = header->rta_len;
    if (length < sizeof(rtattr) || length > attributes.size()) return {};
    if ((header->rta_type & NLA_TYPE_MASK) == wanted)
      return attributes.subspan(sizeof(rtattr), length - sizeof(rtattr));
    attributes = attributes.subspan(std::min<std::size_t>(RTA_ALIGN(length), attributes.size()));
  }
  return {};
}

std::string_view text_of(NetlinkBytes bytes) {
  const auto* text = reinterpret_cast<const char*>(bytes.data());
  return {text, bytes.empty() ? 0 : strnlen(text, bytes.size())};
}

bool send_request(int descriptor, unsigned index) {
  LinkRequest request;
  request.header.nlmsg_len = sizeof(request);
  request.header.nlmsg_type = RTM_GETLINK;
  request.header.nlmsg_flags = NLM_F_REQUEST;
  request.link.ifi_family = AF_UNSPEC;
  request.link.ifi_index = static_cast<int>(index);
  sockaddr_nl kernel{};
  kernel.nl_family = AF_NETLINK;
  return sendto(descriptor, &request, sizeof(request), 0, reinterpret_cast<const sockaddr*>(&kernel),
                sizeof(kernel)) == static_cast<ssize_t>(sizeof(request));
}

/// Attributes of the one link in the answer; empty for an error (the interface has gone).
NetlinkBytes attributes_of(NetlinkBytes answer) {
  constexpr std::size_t kHeaders = NLMSG_HDRLEN + NLMSG_ALIGN(sizeof(ifinfomsg));
  const auto header = value_of<nlmsghdr>(answer);
  if (!header || header->nlmsg_type != RTM_NEWLINK) return {};
  if (header->nlmsg_len < kHeaders || header->nlmsg_len > answer.size()) return {};
  return answer.subspan(kHeaders, header->nlmsg_len - kHeaders);
}

void read_link(NetlinkBytes attributes, CanInterfaceState& state) {
  const NetlinkBytes info = find_attribute(attributes, IFLA_LINKINFO);
  if (text_of(find_attribute(info, IFLA_INFO_KIND)) != "can") return;
  const NetlinkBytes data = find_attribute(info, IFLA_INFO_DATA);
  if (const auto controller = value_of<std::uint32_t>(find_attribute(data, IFLA_CAN_STATE)))
    state.controller = static_cast<int>(*controller);
  if (const auto timing = value_of<can_bittiming>(find_attribute(data, IFLA_CAN_BITTIMING)))
    state.bitrate = timing->bitrate;
  state.restart_ms = value_of<std::uint32_t>(find_attribute(data, IFLA_CAN_RESTART_MS));
  if (const auto statistics = value_of<can_device_stats>(find_attribute(info, IFLA_INFO_XSTATS)))
    state.bus_offs = statistics->bus_off;
}

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

/// Reads the general state of a network interface, which every driver answers at once.
CanInterfaceState read_network_interface(const std::string& name) {
  CanInterfaceState state;
  const FileDescriptor socket(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  if (!socket.is_open()) return state;
  const int descriptor = socket.get();
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
  return state;
}

/// Reads the driver's state over rtnetlink; virtual buses have none. libsocketcan cannot be used: it waits
/// for ever when the interface vanishes during the query, as unplugged adapters do, and prints to standard
/// error.
void query_driver(CanInterfaceState& state) {
  const FileDescriptor socket(::socket(AF_NETLINK, SOCK_RAW | SOCK_CLOEXEC, NETLINK_ROUTE));
  if (!socket.is_open()) return;
  setsockopt(socket.get(), SOL_SOCKET, SO_RCVTIMEO, &kLongestAnswer, sizeof(kLongestAnswer));
  if (!send_request(socket.get(), state.index)) return;
  std::array<std::byte, 16384> answer{};
  const ssize_t size = recv(socket.get(), answer.data(), answer.size(), 0);
  state.silent = size < 0 && (errno == EAGAIN || errno == EWOULDBLOCK);
  if (size > 0) read_link(attributes_of(NetlinkBytes(answer).first(static_cast<std::size_t>(size))), state);
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

/// True for drivers without restart. Kernels before 2025 do not check this and crash on the request. Serial
/// adapters (slcan) have no device and report the kind of their interface instead of a driver.
bool lacks_restart(const std::string& driver) {
  return driver.empty() || driver == "can" || driver == "gs_usb" || driver == "slcan";
}

}  // namespace

bool runs_at(const CanInterfaceState& state, std::uint32_t bitrate) {
  const std::int64_t difference = static_cast<std::int64_t>(state.bitrate.value_or(0)) - bitrate;
  return std::abs(difference) * 20 <= bitrate;
}

CanInterfaceState read_can_interface(const std::string& name) {
  CanInterfaceState state = read_network_interface(name);
  if (state.is_can) query_driver(state);
  return state;
}

/// The kernel serves one query at a time, and a driver in trouble can block it: the query runs in a thread of
/// its own, which is abandoned when it takes longer.
CanInterfaceState query_can_interface(const std::string& name) {
  CanInterfaceState outside = read_network_interface(name);
  if (!outside.is_can) return outside;
  const auto answer = std::make_shared<Answer>();
  std::thread([name, answer] {
    const CanInterfaceState state = read_can_interface(name);
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

bool may_set_up_interfaces() {
  __user_cap_header_struct header{.version = _LINUX_CAPABILITY_VERSION_3, .pid = 0};
  __user_cap_data_struct data[_LINUX_CAPABILITY_U32S_3]{};
  if (syscall(SYS_capget, &header, data) != 0) return false;
  return (data[CAP_TO_INDEX(CAP_NET_ADMIN)].effective & CAP_TO_MASK(CAP_NET_ADMIN)) != 0;
}

void set_up_can_interface(const std::string& name, std::uint32_t bitrate, std::uint32_t restart_ms) {
  const CanInterfaceState before = read_can_interface(name);
  if (!before.is_can) return;
  can_do_stop(name.c_str());
  if (!runs_at(before, bitrate)) can_set_bitrate(name.c_str(), bitrate);
  const bool restarts = restart_ms == 0 || !lacks_restart(before.driver);
  if (restarts && before.restart_ms != restart_ms) can_set_restart_ms(name.c_str(), restart_ms);
  if (before.up || runs_at(read_can_interface(name), bitrate)) can_do_start(name.c_str());
}

void restart_can_controller(const std::string& name, const std::string& driver) {
  if (!lacks_restart(driver)) {
    can_do_restart(name.c_str());
    const CanInterfaceState after = read_can_interface(name);
    if (!after.is_can || after.controller != CAN_STATE_BUS_OFF) return;
  }
  can_do_stop(name.c_str());
  can_do_start(name.c_str());
}

}  // namespace nilio::drivers
