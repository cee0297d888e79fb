#include "drivers/can/can_in_frame.hpp"

#include "drivers/can/socketcan/frame.hpp"
#include "drivers/common/little_endian.hpp"

#include <algorithm>
#include <optional>

#include <pcap/dlt.h>

namespace nilio::drivers {
namespace {

using Bytes = std::span<const std::uint8_t>;

constexpr std::uint16_t kProtocolCan = 0x000C;
constexpr std::uint16_t kProtocolCanFd = 0x000D;
/// CANFD_FDF: the kernel marks CAN FD frames with it since 6.1.
constexpr std::uint8_t kFlexibleFlag = 0x04;
/// Identifier, length, flags and two bytes that are not used.
constexpr std::size_t kHeader = 8;

std::uint16_t load_be16(Bytes bytes, std::size_t at) {
  return static_cast<std::uint16_t>((bytes[at] << 8) | bytes[at + 1]);
}

std::uint32_t load_be32(Bytes bytes, std::size_t at) {
  return (static_cast<std::uint32_t>(load_be16(bytes, at)) << 16) | load_be16(bytes, at + 2);
}

/// The kernel's frame as it was captured, with the identifier in one of two byte orders. The unused bytes
/// after the data may be missing.
CapturedCan read_can(Bytes bytes, bool is_flexible, bool big_endian_id) {
  CapturedCan result;
  result.kind = CapturedCan::Kind::kMalformed;
  if (bytes.size() < kHeader || bytes.size() > CANFD_MTU) return result;
  canfd_frame frame{};
  frame.can_id = big_endian_id ? load_be32(bytes, 0) : load_u32(bytes.data());
  frame.len = bytes[4];
  const Bytes data = bytes.subspan(kHeader);
  if (frame.len > data.size()) return result;
  std::copy_n(data.begin(), frame.len, frame.data);
  const std::optional<CanFrame> can = from_kernel_frame(frame, is_flexible ? CANFD_MTU : CAN_MTU);
  if (!can) return result;
  result.kind = CapturedCan::Kind::kCan;
  result.frame = *can;
  return result;
}

}  // namespace

bool is_cooked_link_type(int link_type) { return link_type == DLT_LINUX_SLL || link_type == DLT_LINUX_SLL2; }

bool may_carry_can(int link_type) { return link_type == DLT_CAN_SOCKETCAN || is_cooked_link_type(link_type); }

CapturedCan find_can_frame(int link_type, Bytes bytes, bool big_endian_host) {
  CapturedCan result;
  if (link_type == DLT_CAN_SOCKETCAN) {
    // Some versions of libpcap clear the flags: then the size tells.
    const bool is_flexible =
        bytes.size() == CANFD_MTU || (bytes.size() >= kHeader && (bytes[5] & kFlexibleFlag) != 0);
    return read_can(bytes, is_flexible, true);
  }
  if (!is_cooked_link_type(link_type)) return result;
  const bool second = link_type == DLT_LINUX_SLL2;
  const std::size_t header = second ? 20 : 16;
  if (bytes.size() < header) {
    result.kind = CapturedCan::Kind::kMalformed;
    return result;
  }
  const std::uint16_t protocol = load_be16(bytes, second ? 0 : 14);
  if (protocol != kProtocolCan && protocol != kProtocolCanFd) return result;
  result = read_can(bytes.subspan(header), protocol == kProtocolCanFd, big_endian_host);
  if (second) result.interface_index = load_be32(bytes, 4);
  return result;
}

}  // namespace nilio::drivers
