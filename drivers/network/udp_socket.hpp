#pragma once

#include "nilio/core/result.hpp"
#include "nilio/drivers/network/udp.hpp"

#include "drivers/common/file_descriptor.hpp"

#include <cstdint>
#include <optional>

namespace nilio::drivers {

/// A bound UDP socket with kernel time stamps and drop counts.
struct UdpSocket {
  FileDescriptor descriptor;
  /// Obtained, without the kernel's own share.
  int receive_buffer_bytes = 0;
};

core::Result<UdpSocket> open_udp_socket(const UdpSourceConfig& config, std::uint16_t port);

/// Datagrams that this socket has lost so far, as the kernel counts (modulo 2^32); nothing where it does not
/// say. The count that comes with a datagram is that of its arrival, so drops after the last one show only
/// here.
std::optional<std::uint32_t> count_kernel_drops(int descriptor);

}  // namespace nilio::drivers
