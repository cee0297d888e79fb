#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>

#include <fastdds/rtps/transport/ChainingTransport.h>
#include <fastdds/rtps/transport/ChainingTransportDescriptor.h>

namespace nilio::dds {

/// Number of bytes of an RTPS datagram before its first statistics submessage (0x80, vendor-specific); all
/// bytes if there is none.
std::size_t bytes_before_statistics(const std::uint8_t* data, std::size_t bytes);

/// UDP transport with workarounds for two defects of Fast DDS 2.9.1.
///
/// It aborts on malformed statistics submessages, which anybody on the network can send. They are not used
/// here, so datagrams are truncated before them.
///
/// A participant announces itself before it listens. It misses the immediate answers of the others and finds
/// them only at their next periodic announcement, up to 3 s later. Therefore nothing is sent before open().
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
