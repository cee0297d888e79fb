#pragma once

#include "nilio/core/time.hpp"

#include <array>
#include <cstdint>

namespace nilio::drivers {

/// Largest UDP payload kept: a Velodyne data packet has 1206 bytes, a position packet 512. Longer datagrams
/// are cut and marked as truncated; they are counted and never decoded.
inline constexpr std::size_t kPacketCapacity = 1240;

/// One received UDP datagram; a ring slot (trivially copyable, 1280 bytes).
struct Packet {
  /// Kernel receive time or capture time.
  core::Time stamp;
  /// CLOCK_MONOTONIC of this process at reception, for latency; ns.
  std::int64_t received_ns = 0;
  /// IPv4 address of the sender and the ports, host byte order.
  std::uint32_t sender_address = 0;
  std::uint16_t sender_port = 0;
  std::uint16_t destination_port = 0;
  /// Used bytes of `data`.
  std::uint16_t size = 0;
  /// The datagram was longer than the slot.
  bool truncated = false;
  std::array<std::uint8_t, kPacketCapacity> data{};
};

/// One CAN or CAN FD frame; a ring slot (trivially copyable).
struct CanFrame {
  /// Kernel receive time or log time.
  core::Time stamp;
  /// CLOCK_MONOTONIC of this process at reception, for latency; ns.
  std::int64_t received_ns = 0;
  /// 11- or 29-bit identifier without flags.
  std::uint32_t id = 0;
  bool extended = false;
  bool remote = false;
  bool error = false;
  bool flexible_data_rate = false;
  /// Used bytes of `data`.
  std::uint8_t length = 0;
  std::array<std::uint8_t, 64> data{};
};

}  // namespace nilio::drivers
