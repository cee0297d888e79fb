#include "nilio/core/units.hpp"
#include "nilio/drivers/capture/pcap.hpp"

#include "drivers/common/byte_order.hpp"
#include "drivers/common/socket.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <limits>

namespace nilio::drivers {
namespace {

constexpr std::size_t kEthernetHeader = 14;
constexpr std::size_t kIpHeader = 20;
constexpr std::size_t kHeaders = kEthernetHeader + kIpHeader + kUdpHeader;
constexpr std::size_t kFileHeader = 24;
constexpr std::size_t kRecordHeader = 16;
constexpr std::size_t kLargestPayload = 65535 - kIpHeader - kUdpHeader;
constexpr std::uint32_t kNanosecondMagic = 0xA1B23C4D;
constexpr std::uint32_t kLongestRecord = 65549;
constexpr std::uint32_t kLinkTypeEthernet = 1;
constexpr std::array<std::uint8_t, 6> kSensorMac{0x60, 0x76, 0x88, 0x00, 0x00, 0x00};
/// 192.168.1.201, the factory address of a Velodyne.
constexpr std::uint32_t kSensorAddress = 0xC0A801C9;

/// Header checksum of RFC 1071.
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
  store_be16(ip + 2, static_cast<std::uint16_t>(kIpHeader + kUdpHeader + payload));
  store_be16(ip + 6, 0x4000);
  ip[8] = 64;
  ip[9] = 17;
  store_be32(ip + 12, endpoints.sender_address);
  store_be32(ip + 16, endpoints.destination_address);
  store_be16(ip + 10, ip_checksum(ip));
  std::uint8_t* udp = ip + kIpHeader;
  store_be16(udp, endpoints.sender_port);
  store_be16(udp + 2, endpoints.destination_port);
  store_be16(udp + 4, static_cast<std::uint16_t>(kUdpHeader + payload));
  // A UDP checksum of zero means "none".
}

/// `original` is the payload's size on the wire; `payload` holds its captured front.
bool append_record(std::vector<std::uint8_t>& out, core::Time stamp, const UdpEndpoints& endpoints,
                   std::span<const std::uint8_t> payload, std::size_t original) {
  const std::int64_t seconds = stamp.ns / kNanosecondsPerSecond;
  if (stamp.ns < 0 || seconds > std::numeric_limits<std::uint32_t>::max() || original > kLargestPayload)
    return false;
  const std::size_t begin = out.size();
  out.resize(begin + kRecordHeader + kHeaders);  // zeros where nothing is stored
  std::uint8_t* record = out.data() + begin;
  store_le32(record, static_cast<std::uint32_t>(seconds));
  store_le32(record + 4, static_cast<std::uint32_t>(stamp.ns % kNanosecondsPerSecond));
  store_le32(record + 8, static_cast<std::uint32_t>(kHeaders + payload.size()));
  store_le32(record + 12, static_cast<std::uint32_t>(kHeaders + original));
  store_headers(record + kRecordHeader, endpoints, original);
  out.insert(out.end(), payload.begin(), payload.end());
  return true;
}

}  // namespace

void append_pcap_header(std::vector<std::uint8_t>& out) {
  const std::size_t begin = out.size();
  out.resize(begin + kFileHeader);
  std::uint8_t* header = out.data() + begin;
  store_le32(header, kNanosecondMagic);
  store_le16(header + 4, 2);
  store_le16(header + 6, 4);
  store_le32(header + 16, kLongestRecord);
  store_le32(header + 20, kLinkTypeEthernet);
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

core::Result<PcapWriter> PcapWriter::create(const std::string& path) {
  PcapWriter writer(FileHandle(std::fopen(path.c_str(), "wbe")));
  if (!writer.file_) {
    return core::Error{path + ": cannot be written (" + std::strerror(errno) +
                       "); check the folder and its permissions"};
  }
  append_pcap_header(writer.record_);
  if (!writer.write_record()) return core::Error{path + ": cannot be written; is the disk full?"};
  return writer;
}

bool PcapWriter::write_record() {
  good_ = good_ && file_ && std::fwrite(record_.data(), 1, record_.size(), file_.get()) == record_.size();
  return good_;
}

bool PcapWriter::write(core::Time stamp, std::uint16_t port, std::span<const std::uint8_t> payload) {
  UdpEndpoints endpoints;
  endpoints.sender_address = kSensorAddress;
  endpoints.sender_port = port;
  endpoints.destination_port = port;
  record_.clear();
  return append_pcap_record(record_, stamp, endpoints, payload) && write_record();
}

bool PcapWriter::close() {
  if (!file_) return good_;
  const bool closed = std::fclose(file_.release()) == 0;
  good_ = good_ && closed;
  return good_;
}

}  // namespace nilio::drivers
