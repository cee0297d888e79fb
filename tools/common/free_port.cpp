#include "tools/common/free_port.hpp"

#include <arpa/inet.h>
#include <cerrno>
#include <cstring>
#include <netinet/in.h>
#include <string>
#include <sys/socket.h>
#include <unistd.h>

namespace nilio::tools {

namespace {

using core::Error;
using core::Result;

/// A socket that keeps a port while others are looked for.
class Probe {
 public:
  Probe() : socket_(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {}
  Probe(const Probe&) = delete;
  Probe& operator=(const Probe&) = delete;
  ~Probe() { close(socket_); }

  Result<std::uint16_t> take(std::uint16_t port) const {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(port);
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t length = sizeof(address);
    auto* const generic = reinterpret_cast<sockaddr*>(&address);
    if (bind(socket_, generic, sizeof(address)) != 0 || getsockname(socket_, generic, &length) != 0)
      return Error{"UDP port " + std::to_string(port) + " of 127.0.0.1 cannot be had (" +
                   std::strerror(errno) + "): choose another --port, or leave it out for any"};
    return ntohs(address.sin_port);
  }

 private:
  int socket_;
};

}  // namespace

Result<std::array<std::uint16_t, 2>> free_udp_ports(std::uint16_t first) {
  const Probe data;
  const Probe position;
  const Result<std::uint16_t> data_port = data.take(first);
  if (!data_port) return data_port.error();
  const Result<std::uint16_t> position_port =
      position.take(first == 0 ? std::uint16_t{0} : static_cast<std::uint16_t>(first + 1));
  if (!position_port) return position_port.error();
  return std::array{*data_port, *position_port};
}

}  // namespace nilio::tools
