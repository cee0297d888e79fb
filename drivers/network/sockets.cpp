#include "drivers/network/sockets.hpp"

#include "drivers/network/interfaces.hpp"

#include <array>
#include <cerrno>
#include <cstring>
#include <linux/filter.h>
#include <linux/if_ether.h>
#include <linux/if_packet.h>
#include <linux/sock_diag.h>
#include <net/if.h>
#include <netinet/in.h>
#include <string>
#include <sys/socket.h>
#include <utility>

namespace nilio::drivers {
namespace {

using core::Error;
using core::Result;

/// Empty when all is well.
using Problem = std::optional<Error>;

std::string bind_advice(int error, std::uint16_t port, bool is_position_port) {
  if (error == EADDRINUSE) {
    return "another program has this port; 'ss -ulpn sport = :" + std::to_string(port) + "' names it" +
           (is_position_port ? "; a position port of 0 disables them" : "");
  }
  if (error == EADDRNOTAVAIL) {
    return "no interface has this address; 'ip -4 address' lists them, 0.0.0.0 means all";
  }
  if (error == EACCES) return "ports below 1024 need CAP_NET_BIND_SERVICE";
  return "check the address and the port";
}

/// Request for IP_ADD_MEMBERSHIP from an address, an interface name or an empty text.
Result<ip_mreqn> find_multicast_interface(const UdpSourceConfig& config) {
  ip_mreqn request{};
  const std::string& wanted =
      config.multicast_interface.empty() ? config.bind_address : config.multicast_interface;
  if (in_addr address{}; const Result<std::uint32_t> parsed = parse_ipv4(wanted, "multicast interface")) {
    address.s_addr = htonl(*parsed);
    request.imr_address = address;
    return request;
  }
  request.imr_ifindex = static_cast<int>(if_nametoindex(wanted.c_str()));
  if (request.imr_ifindex == 0) {
    return Error{"there is no interface '" + wanted +
                 "' to join the multicast group on; 'ip -4 address' lists names and addresses"};
  }
  return request;
}

Problem join(int descriptor, const UdpSourceConfig& config, std::uint32_t group) {
  Result<ip_mreqn> request = find_multicast_interface(config);
  if (!request) return request.error();
  request->imr_multiaddr.s_addr = htonl(group);
  // Without this, the socket also receives groups that other programs joined.
  if (!set_socket_option(descriptor, IPPROTO_IP, IP_MULTICAST_ALL, 0) ||
      !set_socket_option(descriptor, IPPROTO_IP, IP_ADD_MEMBERSHIP, *request)) {
    return Error{"cannot join the multicast group " + config.multicast_group + ": " + std::strerror(errno) +
                 "; name the interface that the sensor is on, by its address or name"};
  }
  return std::nullopt;
}

Result<std::uint32_t> parse_group(const UdpSourceConfig& config) {
  Result<std::uint32_t> group = parse_optional_ipv4(config.multicast_group, "multicast group");
  if (!group || *group == 0) return group;
  if (!IN_MULTICAST(*group)) {
    return Error{config.multicast_group +
                 " is no multicast group; these go from 224.0.0.0 to 239.255.255.255"};
  }
  return group;
}

Problem bind_to(int descriptor, std::uint32_t address, std::uint16_t port, bool is_position_port) {
  sockaddr_in local{};
  local.sin_family = AF_INET;
  local.sin_port = htons(port);
  local.sin_addr.s_addr = htonl(address);
  if (bind(descriptor, reinterpret_cast<const sockaddr*>(&local), sizeof(local)) == 0) return std::nullopt;
  const int error = errno;
  return Error{std::string("cannot listen: ") + std::strerror(error) + "; " +
               bind_advice(error, port, is_position_port)};
}

Result<UdpSocket> open_socket(const UdpSourceConfig& config, std::uint16_t port) {
  const Result<std::uint32_t> local = parse_ipv4(config.bind_address, "address to listen on");
  if (!local) return local.error();
  const Result<std::uint32_t> group = parse_group(config);
  if (!group) return group.error();
  FileDescriptor descriptor(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  if (!descriptor.is_open()) return Error{std::string("no socket: ") + std::strerror(errno)};
  if (!set_socket_option(descriptor.get(), SOL_SOCKET, SO_TIMESTAMPNS, 1) ||
      !set_socket_option(descriptor.get(), SOL_SOCKET, SO_RXQ_OVFL, 1)) {
    return Error{std::string("no kernel time stamps and drop counts: ") + std::strerror(errno)};
  }
  const std::optional<int> buffer = request_receive_buffer(descriptor.get(), config.receive_buffer_bytes);
  if (!buffer) return Error{std::string("the receive buffer cannot be read back: ") + std::strerror(errno)};
  const bool has_group = *group != 0;
  // Multicast datagrams are copied to every socket of the group, so that programs can share the port.
  if (has_group && (!set_socket_option(descriptor.get(), SOL_SOCKET, SO_REUSEADDR, 1) ||
                    !set_socket_option(descriptor.get(), SOL_SOCKET, SO_REUSEPORT, 1))) {
    return Error{std::string("the port cannot be shared: ") + std::strerror(errno)};
  }
  const std::uint32_t address = has_group ? *group : *local;
  if (Problem problem = bind_to(descriptor.get(), address, port, port == config.position_port)) {
    return *problem;
  }
  if (has_group) {
    if (Problem problem = join(descriptor.get(), config, *group)) return *problem;
  }
  return UdpSocket{std::move(descriptor), *buffer};
}

constexpr std::uint32_t kProtocolUdp = 17;

sock_filter statement(int code, std::uint32_t k) { return {static_cast<std::uint16_t>(code), 0, 0, k}; }

/// `yes` and `no` count the instructions that are skipped.
sock_filter jump(int code, std::uint32_t k, std::uint8_t yes, std::uint8_t no) {
  return {static_cast<std::uint16_t>(BPF_JMP | code | BPF_K), yes, no, k};
}

}  // namespace

core::Result<UdpSocket> open_udp_socket(const UdpSourceConfig& config, std::uint16_t port) {
  Result<UdpSocket> opened = open_socket(config, port);
  if (opened) return opened;
  return Error{"UDP " + config.bind_address + ":" + std::to_string(port) + ": " + opened.error().message};
}

std::optional<std::uint32_t> count_kernel_drops(int descriptor) {
  std::array<std::uint32_t, SK_MEMINFO_VARS> values{};
  socklen_t length = sizeof(values);
  if (getsockopt(descriptor, SOL_SOCKET, SO_MEMINFO, values.data(), &length) != 0) return std::nullopt;
  // Kernels before 4.12 do not report drops.
  if (length <= SK_MEMINFO_DROPS * sizeof(std::uint32_t)) return std::nullopt;
  return values[SK_MEMINFO_DROPS];
}

FileDescriptor open_packet_socket(const DatagramFilter& filter) {
  std::array instructions{statement(BPF_LD | BPF_B | BPF_ABS, 9),
                          jump(BPF_JEQ, kProtocolUdp, 0, 7),
                          statement(BPF_LD | BPF_H | BPF_ABS, 6),
                          jump(BPF_JSET, 0x3FFF, 5, 0),
                          statement(BPF_LDX | BPF_B | BPF_MSH, 0),
                          statement(BPF_LD | BPF_H | BPF_IND, static_cast<std::uint32_t>(filter.field)),
                          jump(BPF_JEQ, filter.values[0], 1, 0),
                          jump(BPF_JEQ, filter.values[1], 0, 1),
                          statement(BPF_RET | BPF_K, filter.kept_bytes),
                          statement(BPF_RET | BPF_K, 0)};
  // Protocol 0 receives nothing until bind(), when the filter is in place.
  FileDescriptor socket(::socket(AF_PACKET, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  const sock_fprog program{.len = static_cast<unsigned short>(instructions.size()),
                           .filter = instructions.data()};
  if (!socket.is_open() || set_socket_option(socket.get(), SOL_SOCKET, SO_ATTACH_FILTER, program))
    return socket;
  return {};
}

bool start_packet_socket(const FileDescriptor& socket) {
  sockaddr_ll all{};
  all.sll_family = AF_PACKET;
  all.sll_protocol = htons(ETH_P_IP);
  return bind(socket.get(), reinterpret_cast<const sockaddr*>(&all), sizeof(all)) == 0;
}

}  // namespace nilio::drivers
