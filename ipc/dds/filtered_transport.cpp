#include "ipc/dds/filtered_transport.hpp"

#include "ipc/dds/rtps_filter.hpp"

#include <chrono>
#include <utility>

#include <fastdds/rtps/network/SenderResource.h>
#include <fastdds/rtps/transport/TransportReceiverInterface.h>
#include <fastrtps/utils/IPLocator.h>

namespace nilio::dds {
namespace {

namespace fastdds_rtps = eprosima::fastdds::rtps;
namespace rtps = eprosima::fastrtps::rtps;

class FilteredTransport : public fastdds_rtps::ChainingTransport {
 public:
  explicit FilteredTransport(const FilteredTransportDescriptor& descriptor)
      : ChainingTransport(descriptor), descriptor_(descriptor), gate_(descriptor.gate()) {}

  fastdds_rtps::TransportDescriptorInterface* get_configuration() override { return &descriptor_; }

  // Replaces "any address" by the addresses to announce.
  // NOLINTNEXTLINE(readability-identifier-naming): Fast DDS's name
  rtps::LocatorList_t NormalizeLocator(const rtps::Locator_t& locator) override {
    rtps::LocatorList_t addresses = ChainingTransport::NormalizeLocator(locator);
    if (!rtps::IPLocator::isAny(locator)) return addresses;
    rtps::Locator_t loopback = locator;
    rtps::IPLocator::setIPv4(loopback, "127.0.0.1");
    addresses.push_back(loopback);  // ignored if it is there
    return addresses;
  }

  bool send(rtps::SenderResource* sender, const rtps::octet* data, std::uint32_t bytes,
            rtps::LocatorsIterator* destinations_begin, rtps::LocatorsIterator* destinations_end,
            const std::chrono::steady_clock::time_point& timeout) override {
    if (!*gate_) return true;
    return sender->send(data, bytes, destinations_begin, destinations_end, timeout);
  }

  void receive(fastdds_rtps::TransportReceiverInterface* receiver, const rtps::octet* data,
               std::uint32_t bytes, const rtps::Locator_t& local, const rtps::Locator_t& remote) override {
    receiver->OnDataReceived(data, static_cast<std::uint32_t>(harmless_bytes(data, bytes)), local, remote);
  }

 private:
  FilteredTransportDescriptor descriptor_;
  FilteredTransportDescriptor::Gate gate_;
};

}  // namespace

fastdds_rtps::TransportInterface* FilteredTransportDescriptor::create_transport() const {
  return new FilteredTransport(*this);
}

}  // namespace nilio::dds
