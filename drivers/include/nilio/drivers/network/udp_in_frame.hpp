#pragma once

#include <cstdint>
#include <span>

namespace nilio::drivers {

/// A UDP datagram found in a captured frame.
struct CapturedDatagram {
  enum class Kind {
    kUdp,
    kFragment,   ///< part of a UDP datagram
    kOther,      ///< IPv4, but not UDP
    kNotIpv4,    ///< ARP, IPv6, a link type that is not read ...
    kMalformed,  ///< headers that contradict themselves or end too early
  };
  Kind kind = Kind::kNotIpv4;
  std::uint32_t source_address = 0;
  std::uint16_t source_port = 0;
  std::uint16_t destination_port = 0;
  std::span<const std::uint8_t> payload;
  /// Bytes of the payload by the UDP header.
  std::uint16_t payload_size = 0;
  /// The frame ends before the payload does.
  bool payload_is_cut = false;
};

/// True for the link types that find_datagram() reads (values of libpcap's DLT_*).
bool is_known_link_type(int link_type);

/// Finds IPv4 UDP in a frame. No length in it is trusted: IP's total length is not used, since there are
/// captures where it is wrong; UDP's is, as far as bytes were captured.
CapturedDatagram find_datagram(int link_type, std::span<const std::uint8_t> frame);

}  // namespace nilio::drivers
