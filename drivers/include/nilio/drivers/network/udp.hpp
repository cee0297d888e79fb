#pragma once

#include "nilio/core/result.hpp"
#include "nilio/drivers/source.hpp"

#include <cstdint>
#include <memory>
#include <string>

namespace nilio::drivers {

struct UdpSourceConfig {
  /// A local address; 0.0.0.0 = all.
  std::string bind_address = "0.0.0.0";
  std::uint16_t port = 2368;
  /// Of the position packets; 0 = not listened to.
  std::uint16_t position_port = 8308;
  /// Only datagrams of this sender, which tells several sensors on one port apart; empty = any.
  std::string sender_address{};
  /// Group to join on both ports. Only what is sent to the group is received then, and other programs that
  /// allow it may receive the same. Empty = none.
  std::string multicast_group{};
  /// Address or name of the interface on which to join; empty = the one with `bind_address`, or when that is
  /// 0.0.0.0 the one that the routing table names.
  std::string multicast_interface{};
  int receive_buffer_bytes = 8 * 1024 * 1024;
};

/// Live UDP: recvmmsg straight into the slots, kernel time stamps (SO_TIMESTAMPNS) and drop counter. Both
/// ports of a sensor go into one stream, told apart by destination_port; each port's packets are in order.
/// Fails naming the address, the port and the reason.
///
/// status() tells what was received and the receive buffer obtained; while nothing arrives it tells what was
/// seen instead: other senders, datagrams of other sizes, position packets alone, the state of the link, and
/// (with CAP_NET_RAW) packets of Velodyne's sizes to other addresses and ports.
core::Result<std::unique_ptr<PacketSource>> open_udp(const UdpSourceConfig& config);

}  // namespace nilio::drivers
