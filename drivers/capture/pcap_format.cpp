#include "nilio/drivers/capture/pcap_format.hpp"

#include "drivers/common/little_endian.hpp"

#include <algorithm>
#include <array>
#include <limits>

namespace nilio::drivers {
namespace {

constexpr std::size_t kEthernetHeader = 14;
constexpr std::size_t kIpHeader = 20;
constexpr std::size_t kUdpHeader = 8;
constexpr std::size_t kHeaders = kEthernetHeader + kIpHeader + kUdpHeader;
constexpr std::size_t kFileHeader = 24;
constexpr std::size_t kRecordHeader = 16;
constexpr std::size_t kLargestPayload = 65535 - kIpHeader - kUdpHeader;
constexpr std::int64_t kNsPerSecond = 1'000'000'000;
constexpr std::uint32_t kNanosecondMagic = 0xA1B23C4D;
constexpr std::uint32_t kLongestRecord = 65549;
constexpr std::uint32_t kLinkTypeEthernet = 1;
constexpr std::array<std::uint8_t, 6> kSensorMac{0x60, 0x76, 0x88, 0x00, 0x00, 0x00};

void store_be16(std::uint8_t* p, std::size_t value) {
  p[0] = static_cast<std::uint8_t>(value >> 8);
  p[1] = static_cast<std::uint8_t>(value);
}

void store_be32(std::uint8_t* p, std::uint32_t value) {
  store_be16(p, value >> 16);
  store_be16(p + 2, value & 0xFFFFU);
}

/// RFC 1071.
std::uint16_t ip_checksum(const std::uint8_t* header) {
  std::uint32_t sum = 0;
  for (std::size_t i = 0; i < kIpHeader; i += 2)
    sum += static_cast<std::uint32_t>((header[i] << 8) | header[i + 1]);
  while (sum > 0xFFFF) sum = (sum & 0xFFFF) + (sum >> 16);
  return static_cast<std::uint16_t>(~sum);
}

void store_headers(std::uint8_t* bytes, const UdpEndpoints& endpoints, std::size_t payload) {
  std::fill_n(bytes, 6, std::uint8_t{0xFF});
  std::copy(kSensorMac.begin(), kSensorMac.end(), bytes + 6);
  store_be16(bytes + 12, 0x0800);
  std::uint8_t* ip = bytes + kEthernetHeader;
  ip[0] = 0x45;
  store_be16(ip + 2, kIpHeader + kUdpHeader + payload);
  store_be16(ip + 6, 0x4000);
  ip[8] = 64;
  ip[9] = 17;
  store_be32(ip + 12, endpoints.sender_address);
  store_be32(ip + 16, endpoints.destination_address);
  store_be16(ip + 10, ip_checksum(ip));
  std::uint8_t* udp = ip + kIpHeader;
  store_be16(udp, endpoints.sender_port);
  store_be16(udp + 2, endpoints.destination_port);
  store_be16(udp + 4, kUdpHeader + payload);
  // A UDP checksum of zero means that there is none.
}

/// `original` is the payload's size on the wire, of which `payload` is the front.
bool append_record(std::vector<std::uint8_t>& out, core::Time stamp, const UdpEndpoints& endpoints,
                   std::span<const std::uint8_t> payload, std::size_t original) {
  const std::int64_t seconds = stamp.ns / kNsPerSecond;
  if (stamp.ns < 0 || seconds > std::numeric_limits<std::uint32_t>::max() || original > kLargestPayload)
    return false;
  const std::size_t begin = out.size();
  out.resize(begin + kRecordHeader + kHeaders);  // zeros where nothing is stored
  std::uint8_t* record = out.data() + begin;
  store_u32(record, static_cast<std::uint32_t>(seconds));
  store_u32(record + 4, static_cast<std::uint32_t>(stamp.ns % kNsPerSecond));
  store_u32(record + 8, static_cast<std::uint32_t>(kHeaders + payload.size()));
  store_u32(record + 12, static_cast<std::uint32_t>(kHeaders + original));
  store_headers(record + kRecordHeader, endpoints, original);
  out.insert(out.end(), payload.begin(), payload.end());
  return true;
}

}  // namespace

void append_pcap_header(std::vector<std::uint8_t>& out) {
  const std::size_t begin = out.size();
  out.resize(begin + kFileHeader);
  std::uint8_t* header = out.data() + begin;
  store_u32(header, kNanosecondMagic);
  store_u16(header + 4, 2);
  store_u16(header + 6, 4);
  store_u32(header + 16, kLongestRecord);
  store_u32(header + 20, kLinkTypeEthernet);
}

bool append_pcap_record(std::vector<std::uint8_t>& out, core::Time stamp, const UdpEndpoints& endpoints,
                        std::span<const std::uint8_t> payload) {
  return append_record(out, stamp, endpoints, payload, payload.size());
}

bool append_pcap_record(std::vector<std::uint8_t>& out, const Packet& packet) {
  UdpEndpoints endpoints;
  endpoints.sender_address = packet.sender_address;
  endpoints.sender_port = packet.sender_port;
  endpoints.destination_port = packet.destination_port;
  const std::size_t size = std::min<std::size_t>(packet.size, packet.data.size());
  return append_record(out, packet.stamp, endpoints, std::span(packet.data).first(size),
                       size + (packet.truncated ? 1 : 0));
}

}  // namespace nilio::drivers
