#include "nilio/drivers/network/udp_in_frame.hpp"

#include <algorithm>
#include <optional>

#include <pcap/dlt.h>

namespace nilio::drivers {
namespace {

constexpr std::uint16_t kEtherTypeIpv4 = 0x0800;
constexpr std::uint16_t kEtherTypeVlan = 0x8100;
constexpr std::uint16_t kEtherTypeProviderVlan = 0x88A8;
constexpr std::uint16_t kEtherTypeOldProviderVlan = 0x9100;
constexpr std::uint32_t kLoopbackIpv4 = 2;
constexpr std::uint32_t kLoopbackIpv4Swapped = 0x02000000;
constexpr std::size_t kUdpHeader = 8;
constexpr std::uint16_t kMoreFragmentsOrOffset = 0x3FFF;
constexpr std::uint8_t kProtocolUdp = 17;

std::uint16_t load_be16(std::span<const std::uint8_t> bytes, std::size_t at) {
  return static_cast<std::uint16_t>((bytes[at] << 8) | bytes[at + 1]);
}

std::uint32_t load_be32(std::span<const std::uint8_t> bytes, std::size_t at) {
  return (static_cast<std::uint32_t>(load_be16(bytes, at)) << 16) | load_be16(bytes, at + 2);
}

/// Where the link header's protocol field is and where what it names begins.
struct LinkHeader {
  std::size_t protocol = 0;
  std::size_t size = 0;
};

std::optional<LinkHeader> link_header(int link_type) {
  switch (link_type) {
    case DLT_EN10MB:
      return LinkHeader{12, 14};
    case DLT_LINUX_SLL:
      return LinkHeader{14, 16};
    case DLT_LINUX_SLL2:
      return LinkHeader{0, 20};
    default:
      return std::nullopt;
  }
}

bool is_vlan_tag(std::uint16_t protocol) {
  return protocol == kEtherTypeVlan || protocol == kEtherTypeProviderVlan ||
         protocol == kEtherTypeOldProviderVlan;
}

/// An address family in the byte order of the machine that captured, or (DLT_LOOP) of the network.
bool is_loopback(int link_type) { return link_type == DLT_NULL || link_type == DLT_LOOP; }

bool is_raw_ip(int link_type) { return link_type == DLT_RAW || link_type == DLT_IPV4; }

/// The IPv4 packet inside a frame, empty when it is something else.
std::optional<std::span<const std::uint8_t>> find_ipv4(int link_type, std::span<const std::uint8_t> frame) {
  if (is_raw_ip(link_type)) return frame;
  if (is_loopback(link_type)) {
    if (frame.size() < 4) return std::nullopt;
    const std::uint32_t family = load_be32(frame, 0);
    if (family != kLoopbackIpv4 && family != kLoopbackIpv4Swapped) return std::nullopt;
    return frame.subspan(4);
  }
  const std::optional<LinkHeader> header = link_header(link_type);
  if (!header || frame.size() < header->size) return std::nullopt;
  std::uint16_t protocol = load_be16(frame, header->protocol);
  frame = frame.subspan(header->size);
  while (is_vlan_tag(protocol) && frame.size() >= 4) {
    protocol = load_be16(frame, 2);
    frame = frame.subspan(4);
  }
  if (protocol != kEtherTypeIpv4) return std::nullopt;
  return frame;
}

}  // namespace

bool is_known_link_type(int link_type) {
  return is_raw_ip(link_type) || is_loopback(link_type) || link_header(link_type).has_value();
}

CapturedDatagram find_datagram(int link_type, std::span<const std::uint8_t> frame) {
  CapturedDatagram result;
  const auto ip = find_ipv4(link_type, frame);
  if (!ip || ip->empty() || (*ip)[0] >> 4 != 4) return result;
  const std::size_t header = 4U * ((*ip)[0] & 0x0FU);
  result.kind = CapturedDatagram::Kind::kMalformed;
  if (header < 20 || ip->size() < header) return result;
  if ((*ip)[9] != kProtocolUdp) {
    result.kind = CapturedDatagram::Kind::kOther;
    return result;
  }
  if ((load_be16(*ip, 6) & kMoreFragmentsOrOffset) != 0) {
    result.kind = CapturedDatagram::Kind::kFragment;
    return result;
  }
  const std::span<const std::uint8_t> udp = ip->subspan(header);
  if (udp.size() < kUdpHeader) return result;
  const std::size_t length = load_be16(udp, 4);
  if (length < kUdpHeader) return result;
  result.kind = CapturedDatagram::Kind::kUdp;
  result.source_address = load_be32(*ip, 12);
  result.source_port = load_be16(udp, 0);
  result.destination_port = load_be16(udp, 2);
  result.payload_is_cut = length > udp.size();
  result.payload_size = static_cast<std::uint16_t>(length - kUdpHeader);
  result.payload = udp.subspan(kUdpHeader, std::min(length, udp.size()) - kUdpHeader);
  return result;
}

}  // namespace nilio::drivers
