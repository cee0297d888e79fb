#pragma once

#include "nilio/core/result.hpp"
#include "nilio/drivers/source.hpp"

#include <cstdint>
#include <memory>
#include <string>

namespace nilio::drivers {

struct UdpSourceConfig {
  std::string bind_address = "0.0.0.0";
  std::uint16_t port = 2368;
  /// Only datagrams of this sender; empty = any.
  std::string sender_address;
  int receive_buffer_bytes = 8 * 1024 * 1024;
};

/// Live UDP: recvmmsg straight into the slots, kernel time stamps (SO_TIMESTAMPNS) and drop counter
/// (SO_RXQ_OVFL). Fails naming the address, the port and the reason. status() tells the receive buffer
/// obtained, and when nothing arrives what was seen instead.
core::Result<std::unique_ptr<PacketSource>> open_udp(const UdpSourceConfig& config);

}  // namespace nilio::drivers
