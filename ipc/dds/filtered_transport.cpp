#include "ipc/dds/filtered_transport.hpp"

#include <chrono>
#include <utility>

#include <fastdds/rtps/network/SenderResource.h>
#include <fastdds/rtps/transport/TransportReceiverInterface.h>

namespace nilio::dds {
namespace {

namespace fastdds_rtps = eprosima::fastdds::rtps;
namespace rtps = eprosima::fastrtps::rtps;

// RTPS 2.2, sections 8.3.3 and 9.4.5.
constexpr std::size_t kMessageHeaderBytes = 20;
constexpr std::size_t kSubmessageHeaderBytes = 4;
constexpr std::uint8_t kPad = 0x01;
constexpr std::uint8_t kInfoTimestamp = 0x09;
constexpr std::uint8_t kStatistics = 0x80;

class FilteredTransport : public fastdds_rtps::ChainingTransport {
 public:
  explicit FilteredTransport(const FilteredTransportDescriptor& descriptor)
      : ChainingTransport(descriptor), descriptor_(descriptor), gate_(descriptor.gate()) {}

  fastdds_rtps::TransportDescriptorInterface* get_configuration() override { return &descriptor_; }

  bool send(rtps::SenderResource* sender, const rtps::octet* data, std::uint32_t bytes,
            rtps::LocatorsIterator* destinations_begin, rtps::LocatorsIterator* destinations_end,
            const std::chrono::steady_clock::time_point& timeout) override {
    if (!*gate_) return true;
    return sender->send(data, bytes, destinations_begin, destinations_end, timeout);
  }

  void receive(fastdds_rtps::TransportReceiverInterface* receiver, const rtps::octet* data,
               std::uint32_t bytes, const rtps::Locator_t& local, const rtps::Locator_t& remote) override {
    receiver->OnDataReceived(data, static_cast<std::uint32_t>(bytes_before_statistics(data, bytes)), local,
                             remote);
  }

 private:
  FilteredTransportDescriptor descriptor_;
  FilteredTransportDescriptor::Gate gate_;
};

}  // namespace

std::size_t bytes_before_statistics(const std::uint8_t* data, std::size_t bytes) {
  std::size_t position = kMessageHeaderBytes;
  while (position + kSubmessageHeaderBytes <= bytes) {
    const std::uint8_t kind = data[position];
    if (kind == kStatistics) return position;
    const bool little_endian = (data[position + 1] & 1U) != 0;
    const std::size_t first = data[position + 2];
    const std::size_t second = data[position + 3];
    const std::size_t length = little_endian ? first + 256 * second : 256 * first + second;
    // All submessages but these two extend to the end of the datagram if their length is 0.
    if (length == 0 && kind != kPad && kind != kInfoTimestamp) break;
    // As Fast DDS continues, whatever length a submessage gives.
    position += kSubmessageHeaderBytes + (length + 3) / 4 * 4;
  }
  return bytes;
}

fastdds_rtps::TransportInterface* FilteredTransportDescriptor::create_transport() const {
  return new FilteredTransport(*this);
}

}  // namespace nilio::dds
