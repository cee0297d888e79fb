#pragma once

#include "nilio/core/result.hpp"
#include "nilio/drivers/packet.hpp"

#include <array>
#include <cstdint>
#include <netinet/in.h>
#include <span>
#include <string>
#include <sys/socket.h>

namespace nilio::tools::play {

struct PacketSenderConfig {
  /// Unicast, broadcast or multicast.
  std::string destination_address = "127.0.0.1";
  /// Own address; chooses the interface for broadcast and multicast. Empty = the routing table's choice.
  std::string local_address;
};

/// Sends UDP payloads, many per system call. One thread.
class PacketSender {
 public:
  static constexpr std::size_t kBatch = 64;

  /// Fails with the address and the reason.
  static core::Result<PacketSender> open(const PacketSenderConfig& config);
  PacketSender(PacketSender&& other) noexcept;
  PacketSender& operator=(PacketSender&&) = delete;
  PacketSender(const PacketSender&) = delete;
  PacketSender& operator=(const PacketSender&) = delete;
  ~PacketSender();

  struct Sent {
    std::size_t packets = 0;
    std::size_t failed = 0;
    /// errno of the last failure.
    int error = 0;
  };
  /// Sends at most kBatch packets to their destination_port, in order.
  Sent send(std::span<const drivers::Packet> packets);

 private:
  PacketSender(int descriptor, in_addr destination) : descriptor_(descriptor), destination_(destination) {}

  int descriptor_;
  in_addr destination_;
};

}  // namespace nilio::tools::play
