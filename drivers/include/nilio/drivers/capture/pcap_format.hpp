#pragma once

#include "nilio/core/time.hpp"
#include "nilio/drivers/packet.hpp"

#include <cstdint>
#include <span>
#include <vector>

namespace nilio::drivers {

/// From where to where a datagram went, host byte order.
struct UdpEndpoints {
  std::uint32_t sender_address = 0;
  std::uint16_t sender_port = 0;
  std::uint32_t destination_address = 0xFFFFFFFF;
  std::uint16_t destination_port = 0;
};

/// Appends the header of an Ethernet capture with nanosecond stamps.
void append_pcap_header(std::vector<std::uint8_t>& out);

/// Appends one UDP datagram. False, and nothing appended, for stamps before 1970 or after 2106 and payloads
/// beyond UDP's 65507 bytes, which a capture cannot hold.
bool append_pcap_record(std::vector<std::uint8_t>& out, core::Time stamp, const UdpEndpoints& endpoints,
                        std::span<const std::uint8_t> payload);

/// As received: the sender's address and port and the destination port. A socket does not tell where the
/// datagram was sent, so the destination address is broadcast, as sensors have it from the factory. What was
/// longer than the slot is marked as captured in part.
bool append_pcap_record(std::vector<std::uint8_t>& out, const Packet& packet);

}  // namespace nilio::drivers
