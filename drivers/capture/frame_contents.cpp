#include "nilio/drivers/capture/capture_reader.hpp"

#include "drivers/can/socketcan/can_socket.hpp"
#include "drivers/common/byte_order.hpp"
#include "drivers/common/socket.hpp"

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
constexpr std::uint16_t kMoreFragmentsOrOffset = 0x3FFF;
constexpr std::uint8_t kProtocolUdp = 17;

constexpr std::uint16_t kProtocolCan = 0x000C;
constexpr std::uint16_t kProtocolCanFd = 0x000D;
/// CANFD_FDF: the kernel marks CAN FD frames with it since 6.1.
constexpr std::uint8_t kFlexibleFlag = 0x04;
/// Identifier, length, flags and two unused bytes.
constexpr std::size_t kCanHeader = 8;

using Bytes = std::span<const std::uint8_t>;

/// Offset of the protocol field and size of a link header.
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

/// Loopback headers hold an address family, in the byte order of the capturing machine or (DLT_LOOP) of the
/// network.
bool is_loopback(int link_type) { return link_type == DLT_NULL || link_type == DLT_LOOP; }

bool is_raw_ip(int link_type) { return link_type == DLT_RAW || link_type == DLT_IPV4; }

/// The IPv4 packet inside a frame; nothing for any other content.
std::optional<Bytes> find_ipv4(int link_type, Bytes frame) {
  if (is_raw_ip(link_type)) return frame;
  if (is_loopback(link_type)) {
    if (frame.size() < 4) return std::nullopt;
    const std::uint32_t family = load_be32(frame.data());
    if (family != kLoopbackIpv4 && family != kLoopbackIpv4Swapped) return std::nullopt;
    return frame.subspan(4);
  }
  const std::optional<LinkHeader> header = link_header(link_type);
  if (!header || frame.size() < header->size) return std::nullopt;
  std::uint16_t protocol = load_be16(frame.data() + header->protocol);
  frame = frame.subspan(header->size);
  while (is_vlan_tag(protocol) && frame.size() >= 4) {
    protocol = load_be16(frame.data() + 2);
    frame = frame.subspan(4);
  }
  if (protocol != kEtherTypeIpv4) return std::nullopt;
  return frame;
}

/// Reads the kernel's frame as captured, with the identifier in one of two byte orders. The unused bytes
/// after the data may be missing.
CapturedCan read_can(Bytes bytes, bool is_flexible, bool big_endian_id) {
  CapturedCan result;
  result.kind = CapturedCan::Kind::kMalformed;
  if (bytes.size() < kCanHeader || bytes.size() > CANFD_MTU) return result;
  canfd_frame frame{};
  frame.can_id = big_endian_id ? load_be32(bytes.data()) : load_le32(bytes.data());
  frame.len = bytes[4];
  const Bytes data = bytes.subspan(kCanHeader);
  if (frame.len > data.size()) return result;
  std::copy_n(data.begin(), frame.len, frame.data);
  const std::optional<CanFrame> can = from_kernel_frame(frame, is_flexible ? CANFD_MTU : CAN_MTU);
  if (!can) return result;
  result.kind = CapturedCan::Kind::kCan;
  result.frame = *can;
  return result;
}

}  // namespace

bool is_known_link_type(int link_type) {
  return is_raw_ip(link_type) || is_loopback(link_type) || link_header(link_type).has_value();
}

CapturedDatagram find_datagram(int link_type, Bytes frame) {
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
  if ((load_be16(ip->data() + 6) & kMoreFragmentsOrOffset) != 0) {
    result.kind = CapturedDatagram::Kind::kFragment;
    return result;
  }
  const Bytes udp = ip->subspan(header);
  if (udp.size() < kUdpHeader) return result;
  const std::size_t length = load_be16(udp.data() + 4);
  if (length < kUdpHeader) return result;
  result.kind = CapturedDatagram::Kind::kUdp;
  result.source_address = load_be32(ip->data() + 12);
  result.source_port = load_be16(udp.data());
  result.destination_port = load_be16(udp.data() + 2);
  result.payload_is_cut = length > udp.size();
  result.payload_size = static_cast<std::uint16_t>(length - kUdpHeader);
  result.payload = udp.subspan(kUdpHeader, std::min(length, udp.size()) - kUdpHeader);
  return result;
}

bool is_cooked_link_type(int link_type) { return link_type == DLT_LINUX_SLL || link_type == DLT_LINUX_SLL2; }

bool may_carry_can(int link_type) { return link_type == DLT_CAN_SOCKETCAN || is_cooked_link_type(link_type); }

CapturedCan find_can_frame(int link_type, Bytes bytes, bool big_endian_host) {
  CapturedCan result;
  if (link_type == DLT_CAN_SOCKETCAN) {
    // Some versions of libpcap clear the flags; the size identifies CAN FD then.
    const bool is_flexible =
        bytes.size() == CANFD_MTU || (bytes.size() >= kCanHeader && (bytes[5] & kFlexibleFlag) != 0);
    return read_can(bytes, is_flexible, true);
  }
  if (!is_cooked_link_type(link_type)) return result;
  const bool second = link_type == DLT_LINUX_SLL2;
  const std::size_t header = second ? 20 : 16;
  if (bytes.size() < header) {
    result.kind = CapturedCan::Kind::kMalformed;
    return result;
  }
  const std::uint16_t protocol = load_be16(bytes.data() + (second ? 0 : 14));
  if (protocol != kProtocolCan && protocol != kProtocolCanFd) return result;
  result = read_can(bytes.subspan(header), protocol == kProtocolCanFd, big_endian_host);
  if (second) result.interface_index = load_be32(bytes.data() + 4);
  return result;
}

}  // namespace nilio::drivers
