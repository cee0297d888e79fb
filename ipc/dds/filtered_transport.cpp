#include "ipc/dds/filtered_transport.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <optional>
#include <span>
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
constexpr std::uint8_t kInfoSource = 0x0C;
constexpr std::uint8_t kData = 0x15;
constexpr std::uint8_t kDataFragment = 0x16;
constexpr std::uint8_t kStatistics = 0x80;
// The sender's GUID prefix: in the header of the datagram, and in a submessage that names another source.
constexpr std::size_t kPrefixBytes = 12;
constexpr std::size_t kHeaderPrefix = 8;
constexpr std::size_t kInfoSourceBytes = 20;
constexpr std::size_t kInfoSourcePrefix = kSubmessageHeaderBytes + 8;
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
constexpr std::size_t kWriter = kSubmessageHeaderBytes + 8;
constexpr std::size_t kDataFixedBytes = 16;
constexpr std::size_t kFragmentFixedBytes = 28;
constexpr std::uint8_t kInlineQosFlag = 0x02;
// Fragment: size of the sample, which Fast DDS allocates and touches. The messages read here have kilobytes.
constexpr std::size_t kSampleSize = kSubmessageHeaderBytes + 28;
constexpr std::uint64_t kMaxSampleBytes = std::uint64_t{16} << 20U;
// Announcement of a participant (SPDP): its writer's id, and the parameters that name the participant.
constexpr std::array<std::uint8_t, 4> kAnnouncementWriter{0x00, 0x01, 0x00, 0xC2};
constexpr std::size_t kSentinel = 0x01;
constexpr std::size_t kParticipantGuid = 0x50;
constexpr std::size_t kKeyHash = 0x70;
// Before a parameter list as payload: 0x0002 or 0x0003 (little endian), and options.
constexpr std::size_t kEncapsulationBytes = 4;
constexpr std::uint8_t kLittleEndianList = 0x03;

using Prefix = std::span<const std::uint8_t, kPrefixBytes>;

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

/// Content of a parameter list.
struct Parameters {
  std::size_t bytes = 0;  ///< up to and with its end; more than there are without an end
  bool names_source = false;
  bool names_other = false;  ///< a participant that is not the source
};

Parameters read_parameters(const std::uint8_t* data, std::size_t bytes_left, bool little_endian,
                           Prefix source) {
  Parameters parameters;
  std::size_t& at = parameters.bytes;
  while (at + 4 <= bytes_left) {
    const std::size_t id = read_half(data + at, little_endian);
    const std::size_t length = read_half(data + at + 2, little_endian);
    at += 4;
    if (id == kSentinel) return parameters;
    if (id == kParticipantGuid || id == kKeyHash) {
      const bool is_source =
          at + kPrefixBytes <= bytes_left && std::equal(source.begin(), source.end(), data + at);
      (is_source ? parameters.names_source : parameters.names_other) = true;
    }
    at += (length + 3) / 4 * 4;
  }
  at = bytes_left + 1;
  return parameters;
}

/// Head of data or a fragment, up to the payload.
struct DataHead {
  Parameters inline_qos;
  std::size_t payload = 0;  ///< from the begin of the submessage
  std::size_t end = 0;      ///< of the payload
};

// Empty if what precedes the payload is longer than the submessage: Fast DDS would copy a payload of 4 GiB.
std::optional<DataHead> read_data_head(const std::uint8_t* submessage, std::size_t bytes_left,
                                       bool little_endian, Prefix source) {
  const std::size_t fixed = submessage[0] == kData ? kDataFixedBytes : kFragmentFixedBytes;
  if (bytes_left < kBytesToInlineQos + 2 + fixed) return std::nullopt;
  const std::size_t length = read_half(submessage + 2, little_endian);
  const std::size_t body = length == 0 ? bytes_left - kSubmessageHeaderBytes : length;
  const std::size_t to_inline_qos = read_half(submessage + kBytesToInlineQos, little_endian);
  DataHead head;
  head.payload = kBytesToInlineQos + 2 + std::max(to_inline_qos, fixed);
  if ((submessage[1] & kInlineQosFlag) != 0) {
    if (head.payload > bytes_left) return std::nullopt;
    head.inline_qos =
        read_parameters(submessage + head.payload, bytes_left - head.payload, little_endian, source);
    head.payload += head.inline_qos.bytes;
  }
  if (4 + to_inline_qos + head.inline_qos.bytes > body) return std::nullopt;
  head.end = std::min(kSubmessageHeaderBytes + body, bytes_left);
  return head;
}

// Fast DDS keeps the highest number of an announcement's sender for ever, known or not, and ignores those up
// to it: an announcement in the name of another participant hides that one when it comes.
bool is_foreign_announcement(const std::uint8_t* submessage, const DataHead& head, Prefix source) {
  if (!std::equal(kAnnouncementWriter.begin(), kAnnouncementWriter.end(), submessage + kWriter)) return false;
  if (submessage[0] == kDataFragment) return true;
  Parameters payload;
  if (const std::size_t list = head.payload + kEncapsulationBytes; list <= head.end)
    payload = read_parameters(submessage + list, head.end - list,
                              submessage[head.payload + 1] == kLittleEndianList, source);
  return head.inline_qos.names_other || payload.names_other ||
         !(head.inline_qos.names_source || payload.names_source);
}

bool is_harmful_data(const std::uint8_t* submessage, std::size_t bytes_left, bool little_endian,
                     Prefix source) {
  const std::optional<DataHead> head = read_data_head(submessage, bytes_left, little_endian, source);
  if (!head || is_foreign_announcement(submessage, *head, source)) return true;
  return submessage[0] == kDataFragment && bytes_left >= kSampleSize + 4 &&
         read_word(submessage + kSampleSize, little_endian) > kMaxSampleBytes;
}

// True if Fast DDS would abort at this submessage, be busy with it for minutes, run out of memory, or be deaf
// to a participant afterwards.
bool is_harmful(const std::uint8_t* submessage, std::size_t bytes_left, bool little_endian, Prefix source) {
  const std::uint8_t kind = submessage[0];
  if (kind == kStatistics) return true;
  if (kind == kData || kind == kDataFragment)
    return is_harmful_data(submessage, bytes_left, little_endian, source);
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
  std::size_t source = kHeaderPrefix;
  while (position + kSubmessageHeaderBytes <= bytes) {
    const std::uint8_t kind = data[position];
    const bool little_endian = (data[position + 1] & 1U) != 0;
    if (is_harmful(data + position, bytes - position, little_endian, Prefix(data + source, kPrefixBytes)))
      return position;
    const std::size_t length = read_half(data + position + 2, little_endian);
    // All submessages but these two extend to the end of the datagram if their length is 0.
    if (length == 0 && kind != kPad && kind != kInfoTimestamp) break;
    if (kind == kInfoSource && length == kInfoSourceBytes &&
        position + kInfoSourcePrefix + kPrefixBytes <= bytes)
      source = position + kInfoSourcePrefix;
    // As Fast DDS continues, whatever length a submessage gives.
    position += kSubmessageHeaderBytes + (length + 3) / 4 * 4;
  }
  return bytes;
}

fastdds_rtps::TransportInterface* FilteredTransportDescriptor::create_transport() const {
  return new FilteredTransport(*this);
}

}  // namespace nilio::dds
