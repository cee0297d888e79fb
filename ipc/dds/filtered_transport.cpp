#include "ipc/dds/filtered_transport.hpp"

#include <algorithm>
#include <chrono>
#include <utility>

#include <fastdds/rtps/network/SenderResource.h>
#include <fastdds/rtps/transport/TransportReceiverInterface.h>
#include <fastrtps/utils/IPLocator.h>

namespace nilio::dds {
namespace {

namespace fastdds_rtps = eprosima::fastdds::rtps;
namespace rtps = eprosima::fastrtps::rtps;

// RTPS 2.2, sections 8.3.3 and 9.4.5.
constexpr std::size_t kMessageHeaderBytes = 20;
constexpr std::size_t kSubmessageHeaderBytes = 4;
constexpr std::uint8_t kPad = 0x01;
constexpr std::uint8_t kHeartbeat = 0x07;
constexpr std::uint8_t kGap = 0x08;
constexpr std::uint8_t kInfoTimestamp = 0x09;
constexpr std::uint8_t kData = 0x15;
constexpr std::uint8_t kDataFragment = 0x16;
constexpr std::uint8_t kStatistics = 0x80;
// Heartbeat and gap: ids of reader and writer, then two sequence numbers.
constexpr std::size_t kFirstNumber = kSubmessageHeaderBytes + 8;
constexpr std::size_t kSecondNumber = kFirstNumber + 8;
// Fast DDS visits every number up to the announced one. A writer with 10 samples per second needs 19 days.
constexpr std::uint64_t kMaxSequenceNumber = std::uint64_t{1} << 24U;
// It remembers every number of a gap. A longer one only says what the heartbeat says, too.
constexpr std::uint64_t kMaxGap = std::uint64_t{1} << 16U;
// Data and fragment: extra flags, bytes from here to the inline QoS, ids, sequence number and so on, inline
// QoS.
constexpr std::size_t kBytesToInlineQos = kSubmessageHeaderBytes + 2;
constexpr std::size_t kDataFixedBytes = 16;
constexpr std::size_t kFragmentFixedBytes = 28;
constexpr std::uint8_t kInlineQosFlag = 0x02;
constexpr std::size_t kSentinel = 1;
// Fragment: size of the sample, which Fast DDS allocates and touches. The messages read here have kilobytes.
constexpr std::size_t kSampleSize = kSubmessageHeaderBytes + 28;
constexpr std::uint64_t kMaxSampleBytes = std::uint64_t{16} << 20U;

std::uint64_t read_word(const std::uint8_t* data, bool little_endian) {
  std::uint64_t word = 0;
  for (std::size_t i = 0; i < 4; ++i) word = 256 * word + data[little_endian ? 3 - i : i];
  return word;
}

// The high word comes first.
std::uint64_t read_sequence_number(const std::uint8_t* data, bool little_endian) {
  return (read_word(data, little_endian) << 32U) + read_word(data + 4, little_endian);
}

std::size_t read_half(const std::uint8_t* data, bool little_endian) {
  return little_endian ? data[0] + 256U * data[1] : 256U * data[0] + data[1];
}

// Bytes of a parameter list up to and with its end; more than `bytes_left` without one.
std::size_t parameter_list_bytes(const std::uint8_t* data, std::size_t bytes_left, bool little_endian) {
  std::size_t position = 0;
  while (position + 4 <= bytes_left) {
    const std::size_t id = read_half(data + position, little_endian);
    const std::size_t length = read_half(data + position + 2, little_endian);
    if (id == kSentinel) return position + 4;
    position += 4 + (length + 3) / 4 * 4;
  }
  return bytes_left + 1;
}

// True if what precedes the payload is longer than the submessage: Fast DDS would copy a payload of 4 GiB.
bool has_negative_payload(const std::uint8_t* submessage, std::size_t bytes_left, bool little_endian) {
  const std::size_t fixed = submessage[0] == kData ? kDataFixedBytes : kFragmentFixedBytes;
  if (bytes_left < kBytesToInlineQos + 2 + fixed) return true;
  const std::size_t length = read_half(submessage + 2, little_endian);
  const std::size_t body = length == 0 ? bytes_left - kSubmessageHeaderBytes : length;
  const std::size_t to_inline_qos = read_half(submessage + kBytesToInlineQos, little_endian);
  std::size_t used = 4 + to_inline_qos;
  if ((submessage[1] & kInlineQosFlag) != 0) {
    const std::size_t begin = kBytesToInlineQos + 2 + std::max(to_inline_qos, fixed);
    if (begin > bytes_left) return true;
    used += parameter_list_bytes(submessage + begin, bytes_left - begin, little_endian);
  }
  return used > body;
}

// True if Fast DDS would abort at this submessage, be busy with it for minutes, or run out of memory.
bool is_harmful(const std::uint8_t* submessage, std::size_t bytes_left, bool little_endian) {
  const std::uint8_t kind = submessage[0];
  if (kind == kStatistics) return true;
  if ((kind == kData || kind == kDataFragment) && has_negative_payload(submessage, bytes_left, little_endian))
    return true;
  if (kind == kDataFragment && bytes_left >= kSampleSize + 4)
    return read_word(submessage + kSampleSize, little_endian) > kMaxSampleBytes;
  if ((kind != kHeartbeat && kind != kGap) || bytes_left < kSecondNumber + 8) return false;
  const std::uint64_t first = read_sequence_number(submessage + kFirstNumber, little_endian);
  const std::uint64_t second = read_sequence_number(submessage + kSecondNumber, little_endian);
  if (first > kMaxSequenceNumber || second > kMaxSequenceNumber) return true;
  return kind == kGap && second > first + kMaxGap;
}

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

std::size_t harmless_bytes(const std::uint8_t* data, std::size_t bytes) {
  std::size_t position = kMessageHeaderBytes;
  while (position + kSubmessageHeaderBytes <= bytes) {
    const std::uint8_t kind = data[position];
    const bool little_endian = (data[position + 1] & 1U) != 0;
    if (is_harmful(data + position, bytes - position, little_endian)) return position;
    const std::size_t length = read_half(data + position + 2, little_endian);
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
