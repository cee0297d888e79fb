#include "nilio/drivers/pcap.hpp"

#include "little_endian.hpp"

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
constexpr std::size_t kUdpHeader = 8;
constexpr std::size_t kHeaders = kEthernetHeader + kIpHeader + kUdpHeader;
constexpr std::size_t kRecordHeader = 16;
constexpr std::size_t kLargestPayload = 65535 - kIpHeader - kUdpHeader;
constexpr std::int64_t kNsPerSecond = 1'000'000'000;
constexpr std::uint32_t kNanosecondMagic = 0xA1B23C4D;
constexpr std::uint32_t kLinkTypeEthernet = 1;
constexpr std::array<std::uint8_t, 6> kSensorMac{0x60, 0x76, 0x88, 0x00, 0x00, 0x00};
/// From, to.
constexpr std::array<std::uint8_t, 8> kAddresses{192, 168, 1, 201, 255, 255, 255, 255};

void store_be16(std::uint8_t* p, std::size_t value) {
  p[0] = static_cast<std::uint8_t>(value >> 8);
  p[1] = static_cast<std::uint8_t>(value);
}

/// RFC 1071.
std::uint16_t ip_checksum(const std::uint8_t* header) {
  std::uint32_t sum = 0;
  for (std::size_t i = 0; i < kIpHeader; i += 2)
    sum += static_cast<std::uint32_t>((header[i] << 8) | header[i + 1]);
  while (sum > 0xFFFF) sum = (sum & 0xFFFF) + (sum >> 16);
  return static_cast<std::uint16_t>(~sum);
}

std::array<std::uint8_t, kHeaders> make_headers(std::uint16_t port, std::size_t payload) {
  std::array<std::uint8_t, kHeaders> bytes{};
  std::fill_n(bytes.begin(), 6, std::uint8_t{0xFF});
  std::copy(kSensorMac.begin(), kSensorMac.end(), bytes.begin() + 6);
  store_be16(bytes.data() + 12, 0x0800);
  std::uint8_t* ip = bytes.data() + kEthernetHeader;
  ip[0] = 0x45;
  store_be16(ip + 2, kIpHeader + kUdpHeader + payload);
  store_be16(ip + 6, 0x4000);
  ip[8] = 64;
  ip[9] = 17;
  std::copy(kAddresses.begin(), kAddresses.end(), ip + 12);
  store_be16(ip + 10, ip_checksum(ip));
  std::uint8_t* udp = ip + kIpHeader;
  store_be16(udp, port);
  store_be16(udp + 2, port);
  store_be16(udp + 4, kUdpHeader + payload);
  // A UDP checksum of zero means that there is none.
  return bytes;
}

}  // namespace

struct PcapWriter::State {
  explicit State(std::FILE* opened) : file(opened) {}
  State(const State&) = delete;
  State& operator=(const State&) = delete;
  ~State() {
    if (file != nullptr) std::fclose(file);
  }

  bool put(const void* bytes, std::size_t count) {
    good = good && file != nullptr && std::fwrite(bytes, 1, count, file) == count;
    return good;
  }

  std::FILE* file;
  bool good = true;
};

PcapWriter::PcapWriter(std::unique_ptr<State> state) : state_(std::move(state)) {}
PcapWriter::PcapWriter(PcapWriter&&) noexcept = default;
PcapWriter& PcapWriter::operator=(PcapWriter&&) noexcept = default;
PcapWriter::~PcapWriter() = default;

core::Result<PcapWriter> PcapWriter::create(const std::string& path) {
  std::FILE* file = std::fopen(path.c_str(), "wbe");
  if (file == nullptr) {
    return core::Error{path + ": cannot be written (" + std::strerror(errno) +
                       "); check the folder and its permissions"};
  }
  auto state = std::make_unique<State>(file);
  std::array<std::uint8_t, 24> header{};
  store_u32(header.data(), kNanosecondMagic);
  store_u16(header.data() + 4, 2);
  store_u16(header.data() + 6, 4);
  store_u32(header.data() + 16, 65549);
  store_u32(header.data() + 20, kLinkTypeEthernet);
  if (!state->put(header.data(), header.size()))
    return core::Error{path + ": cannot be written; is the disk full?"};
  return PcapWriter(std::move(state));
}

bool PcapWriter::write(core::Time stamp, std::uint16_t port, std::span<const std::uint8_t> payload) {
  const std::int64_t seconds = stamp.ns / kNsPerSecond;
  if (stamp.ns < 0 || seconds > std::numeric_limits<std::uint32_t>::max() || payload.size() > kLargestPayload)
    return false;
  const auto size = static_cast<std::uint32_t>(kHeaders + payload.size());
  std::array<std::uint8_t, kRecordHeader> record{};
  store_u32(record.data(), static_cast<std::uint32_t>(seconds));
  store_u32(record.data() + 4, static_cast<std::uint32_t>(stamp.ns % kNsPerSecond));
  store_u32(record.data() + 8, size);
  store_u32(record.data() + 12, size);
  const std::array<std::uint8_t, kHeaders> headers = make_headers(port, payload.size());
  return state_->put(record.data(), record.size()) && state_->put(headers.data(), headers.size()) &&
         state_->put(payload.data(), payload.size());
}

bool PcapWriter::close() {
  if (state_->file == nullptr) return state_->good;
  const bool closed = std::fclose(state_->file) == 0;
  state_->file = nullptr;
  state_->good = state_->good && closed;
  return state_->good;
}

}  // namespace nilio::drivers
