#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>

#include <fastdds/rtps/transport/ChainingTransport.h>
#include <fastdds/rtps/transport/ChainingTransportDescriptor.h>

namespace nilio::dds {

/// Number of bytes of an RTPS datagram before its first submessage that harms Fast DDS 2.9.1; all bytes if
/// there is none: statistics (0x80, vendor-specific), on which it aborts; data whose inline QoS is longer
/// than the submessage, which it copies as 4 GiB; heartbeats and gaps with sequence numbers that no writer
/// reaches, which it counts through one by one; fragments of samples beyond 16 MiB, which it allocates;
/// announcements of a participant (SPDP) in the name of another, which it never hears afterwards.
std::size_t harmless_bytes(const std::uint8_t* data, std::size_t bytes);

/// UDP transport with workarounds for three defects of Fast DDS 2.9.1.
///
/// A single datagram of anybody on the network can abort, occupy or deafen it. Datagrams are truncated to
/// their harmless_bytes().
///
/// A participant announces itself before it listens. It misses the immediate answers of the others and finds
/// them only at their next periodic announcement, up to 3 s later. Therefore nothing is sent before open().
///
/// It listens on loopback but announces loopback only on a machine without a network. Nodes that are bound to
/// localhost then cannot answer. Therefore loopback is announced, too; nodes of other machines ignore it.
class FilteredTransportDescriptor : public eprosima::fastdds::rtps::ChainingTransportDescriptor {
 public:
  using Gate = std::shared_ptr<std::atomic<bool>>;

  explicit FilteredTransportDescriptor(
      std::shared_ptr<eprosima::fastdds::rtps::TransportDescriptorInterface> low_level)
      : ChainingTransportDescriptor(std::move(low_level)),
        gate_(std::make_shared<std::atomic<bool>>(false)) {}

  void open() { *gate_ = true; }
  [[nodiscard]] const Gate& gate() const { return gate_; }
  eprosima::fastdds::rtps::TransportInterface* create_transport() const override;

 private:
  Gate gate_;
};

}  // namespace nilio::dds
