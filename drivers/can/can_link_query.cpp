#include "drivers/can/can_link_query.hpp"

#include "drivers/can/socketcan/socket.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstddef>
#include <cstring>
#include <linux/can/netlink.h>
#include <linux/if_link.h>
#include <linux/rtnetlink.h>
#include <optional>
#include <span>
#include <string_view>
#include <sys/socket.h>
#include <sys/time.h>

namespace nilio::drivers {
namespace {

using Bytes = std::span<const std::byte>;

constexpr timeval kLongestWait{.tv_sec = 0, .tv_usec = 300'000};

struct LinkRequest {
  nlmsghdr header{};
  ifinfomsg link{};
};

template <class Value>
std::optional<Value> value_of(Bytes bytes) {
  if (bytes.size() < sizeof(Value)) return std::nullopt;
  Value value{};
  std::memcpy(&value, bytes.data(), sizeof(Value));
  return value;
}

/// The attribute's content; empty when it is not there.
Bytes find_attribute(Bytes attributes, unsigned wanted) {
  while (const std::optional<rtattr> header = value_of<rtattr>(attributes)) {
    const std::size_t length = header->rta_len;
    if (length < sizeof(rtattr) || length > attributes.size()) return {};
    if ((header->rta_type & NLA_TYPE_MASK) == wanted)
      return attributes.subspan(sizeof(rtattr), length - sizeof(rtattr));
    attributes = attributes.subspan(std::min<std::size_t>(RTA_ALIGN(length), attributes.size()));
  }
  return {};
}

std::string_view text_of(Bytes bytes) {
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

/// The attributes of the one link in the answer; empty for an error, which is that of an interface that has
/// gone.
Bytes attributes_of(Bytes answer) {
  constexpr std::size_t kHeaders = NLMSG_HDRLEN + NLMSG_ALIGN(sizeof(ifinfomsg));
  const auto header = value_of<nlmsghdr>(answer);
  if (!header || header->nlmsg_type != RTM_NEWLINK) return {};
  if (header->nlmsg_len < kHeaders || header->nlmsg_len > answer.size()) return {};
  return answer.subspan(kHeaders, header->nlmsg_len - kHeaders);
}

void read_link(Bytes attributes, CanInterfaceState& state) {
  const Bytes info = find_attribute(attributes, IFLA_LINKINFO);
  if (text_of(find_attribute(info, IFLA_INFO_KIND)) != "can") return;
  const Bytes data = find_attribute(info, IFLA_INFO_DATA);
  if (const auto controller = value_of<std::uint32_t>(find_attribute(data, IFLA_CAN_STATE)))
    state.controller = static_cast<int>(*controller);
  if (const auto timing = value_of<can_bittiming>(find_attribute(data, IFLA_CAN_BITTIMING)))
    state.bitrate = timing->bitrate;
  state.restart_ms = value_of<std::uint32_t>(find_attribute(data, IFLA_CAN_RESTART_MS));
  if (const auto statistics = value_of<can_device_stats>(find_attribute(info, IFLA_INFO_XSTATS)))
    state.bus_offs = statistics->bus_off;
}

}  // namespace

void ask_can_driver(CanInterfaceState& state) {
  const CanSocket socket(::socket(AF_NETLINK, SOCK_RAW | SOCK_CLOEXEC, NETLINK_ROUTE));
  if (socket.get() < 0) return;
  setsockopt(socket.get(), SOL_SOCKET, SO_RCVTIMEO, &kLongestWait, sizeof(kLongestWait));
  if (!send_request(socket.get(), state.index)) return;
  std::array<std::byte, 16384> answer{};
  const ssize_t size = recv(socket.get(), answer.data(), answer.size(), 0);
  state.silent = size < 0 && (errno == EAGAIN || errno == EWOULDBLOCK);
  if (size > 0) read_link(attributes_of(Bytes(answer).first(static_cast<std::size_t>(size))), state);
}

}  // namespace nilio::drivers
