#pragma once

#include "nilio/core/result.hpp"
#include "nilio/drivers/source.hpp"

#include <cstdint>
#include <memory>
#include <string>

namespace nilio::drivers {

struct UdpSourceConfig {
  /// Local address; 0.0.0.0 = all.
  std::string bind_address = "0.0.0.0";
  std::uint16_t port = 2368;
  /// Port of the position packets; 0 = none.
  std::uint16_t position_port = 8308;
  /// Accept only this sender, to separate several sensors on one port; empty = any.
  std::string sender_address{};
  /// Multicast group to join on both ports; then only datagrams to the group are received, and other programs
  /// may share the port. Empty = none.
  std::string multicast_group{};
  /// Address or name of the interface on which to join; empty = that of `bind_address`, or the routing
  /// table's choice for 0.0.0.0.
  std::string multicast_interface{};
  int receive_buffer_bytes = 8 * 1024 * 1024;
};

/// Live UDP: recvmmsg straight into the slots, kernel time stamps (SO_TIMESTAMPNS) and drop counter. Both
/// ports of a sensor go into one stream, distinguished by destination_port; each port's packets are in order.
/// Errors name the address, the port and the reason.
///
/// status() reports the received packets and the receive buffer; while nothing arrives also other senders,
/// datagrams of other sizes, position packets alone, the state of the link, and (with CAP_NET_RAW) packets of
/// Velodyne's sizes to other addresses and ports.
core::Result<std::unique_ptr<PacketSource>> open_udp(const UdpSourceConfig& config);

/// As open_udp() for one port (`position_port` 0). If another program, such as niliod, has the port, the
/// source delivers copies of the datagrams that this program receives, with the same kernel time stamps; this
/// needs CAP_NET_RAW.
core::Result<std::unique_ptr<PacketSource>> open_udp_or_tap(const UdpSourceConfig& config);

}  // namespace nilio::drivers
