#pragma once

#include "nilio/core/result.hpp"
#include "nilio/drivers/network/udp.hpp"

#include "drivers/common/socket.hpp"

#include <cstdint>
#include <optional>

namespace nilio::drivers {

/// Bound UDP socket with kernel time stamps and drop counts.
struct UdpSocket {
  FileDescriptor descriptor;
  /// Obtained size, without the kernel's own share.
  int receive_buffer_bytes = 0;
};

/// Opens and binds the socket, joins the multicast group. The error names the address, the port, the reason
/// and the remedy.
core::Result<UdpSocket> open_udp_socket(const UdpSourceConfig& config, std::uint16_t port);

/// Datagrams dropped by this socket so far, by the kernel's count (modulo 2^32); nothing when the kernel does
/// not report it. Drops after the last received datagram show only here.
std::optional<std::uint32_t> count_kernel_drops(int descriptor);

}  // namespace nilio::drivers
