#include "tools/play/sender.hpp"

#include <algorithm>
#include <arpa/inet.h>
#include <cerrno>
#include <cstring>
#include <optional>
#include <unistd.h>
#include <utility>

namespace nilio::tools::play {

namespace {

using core::Error;

std::optional<in_addr> parse_address(const std::string& text) {
  in_addr address{};
  if (inet_pton(AF_INET, text.c_str(), &address) != 1) return std::nullopt;
  return address;
}

Error no_address(const std::string& text, const char* option) {
  return Error{std::string(option) + ": '" + text + "' is no IPv4 address - write it as 192.168.1.100"};
}

}  // namespace

core::Result<PacketSender> PacketSender::open(const PacketSenderConfig& config) {
  const std::optional<in_addr> destination = parse_address(config.destination_address);
  if (!destination) return no_address(config.destination_address, "--to");
  const int descriptor = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (descriptor < 0) return Error{std::string("no UDP socket: ") + std::strerror(errno)};
  PacketSender sender(descriptor, *destination);
  const int on = 1;
  if (setsockopt(descriptor, SOL_SOCKET, SO_BROADCAST, &on, sizeof(on)) != 0)
    return Error{std::string("broadcast is refused: ") + std::strerror(errno)};
  if (config.local_address.empty()) return sender;
  const std::optional<in_addr> local = parse_address(config.local_address);
  if (!local) return no_address(config.local_address, "--from");
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr = *local;
  if (bind(descriptor, reinterpret_cast<const sockaddr*>(&address), sizeof(address)) != 0 ||
      setsockopt(descriptor, IPPROTO_IP, IP_MULTICAST_IF, &*local, sizeof(*local)) != 0)
    return Error{"--from " + config.local_address + ": not available as sender (" + std::strerror(errno) +
                 "); 'ip -4 address' lists this computer's addresses"};
  return sender;
}

PacketSender::PacketSender(PacketSender&& other) noexcept
    : descriptor_(std::exchange(other.descriptor_, -1)), destination_(other.destination_) {}

PacketSender::~PacketSender() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

PacketSender::Sent PacketSender::send(std::span<const drivers::Packet> packets) {
  std::array<mmsghdr, kBatch> messages{};
  std::array<iovec, kBatch> buffers{};
  std::array<sockaddr_in, kBatch> destinations{};
  const std::size_t count = std::min(packets.size(), kBatch);
  for (std::size_t i = 0; i < count; ++i) {
    destinations[i].sin_family = AF_INET;
    destinations[i].sin_port = htons(packets[i].destination_port);
    destinations[i].sin_addr = destination_;
    // sendmmsg does not write; iovec has no const member.
    buffers[i] = {.iov_base = const_cast<std::uint8_t*>(packets[i].data.data()), .iov_len = packets[i].size};
    messages[i].msg_hdr.msg_name = &destinations[i];
    messages[i].msg_hdr.msg_namelen = sizeof(sockaddr_in);
    messages[i].msg_hdr.msg_iov = &buffers[i];
    messages[i].msg_hdr.msg_iovlen = 1;
  }
  Sent result;
  for (std::size_t done = 0; done < count;) {
    const int sent = sendmmsg(descriptor_, &messages[done], static_cast<unsigned>(count - done), 0);
    if (sent < 0 && errno == EINTR) continue;
    if (sent > 0) {
      result.packets += static_cast<std::size_t>(sent);
      done += static_cast<std::size_t>(sent);
      continue;
    }
    // The first remaining packet failed; the others may succeed.
    result.error = errno;
    ++result.failed;
    ++done;
  }
  return result;
}

}  // namespace nilio::tools::play
