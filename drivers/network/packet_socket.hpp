#pragma once

#include "drivers/common/socket.hpp"

#include <array>
#include <cstdint>

namespace nilio::drivers {

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
