#pragma once

#include "nilio/core/result.hpp"
#include "nilio/drivers/network/udp.hpp"

#include "drivers/common/socket.hpp"

#include <array>
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

/// Which UDP datagrams a packet socket receives.
struct DatagramFilter {
  enum class Field : std::uint8_t { kDestinationPort = 2, kLength = 4 };  ///< offset in the UDP header
  Field field = Field::kDestinationPort;
  /// The field has one of these values.
  std::array<std::uint16_t, 2> values{};
  /// Bytes kept of a datagram, from its IP header on.
  std::uint32_t kept_bytes = 0;
};

/// Opens a socket that receives copies of the unfragmented IPv4 datagrams of all interfaces, whichever
/// program they are for; the data begins at the IP header. Receives nothing until start_packet_socket(). Not
/// open, with errno, on failure; EPERM without CAP_NET_RAW. Does not allocate.
FileDescriptor open_packet_socket(const DatagramFilter& filter);

/// False on failure (errno).
bool start_packet_socket(const FileDescriptor& socket);

}  // namespace nilio::drivers
