#pragma once

#include "nilio/drivers/packet.hpp"

#include <cstddef>
#include <cstdint>
#include <span>

namespace nilio::drivers {

/// A CAN frame found in a captured one.
struct CapturedCan {
  enum class Kind {
    kCan,
    kOther,      ///< something else than CAN
    kMalformed,  ///< CAN, but cut short or with a length that does not exist
  };
  Kind kind = Kind::kOther;
  /// Without its stamps.
  CanFrame frame;
  /// The number of the network interface in the cooked header of 'tcpdump -i any', 0 where there is none.
  std::uint32_t interface_index = 0;
};

/// True for the link types that CAN frames come in: SocketCAN, and cooked (values of libpcap's DLT_*).
bool may_carry_can(int link_type);
/// True for the cooked link types, where one capture has the frames of many interfaces.
bool is_cooked_link_type(int link_type);

/// `big_endian_host`: the machine that captured; cooked captures have its byte order in the identifier.
CapturedCan find_can_frame(int link_type, std::span<const std::uint8_t> bytes, bool big_endian_host);

}  // namespace nilio::drivers
