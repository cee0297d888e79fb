#include "can_capture_reader.hpp"

#include "can_in_frame.hpp"

#include <algorithm>
#include <cstring>

#include <pcap/pcap.h>

namespace nilio::drivers {
namespace {

constexpr std::uint32_t kSectionHeader = 0x0A0D0D0A;
constexpr std::uint32_t kInterfaceDescription = 1;
constexpr std::uint32_t kObsoletePacket = 2;
constexpr std::uint32_t kSimplePacket = 3;
constexpr std::uint32_t kEnhancedPacket = 6;
constexpr std::uint32_t kByteOrderMagic = 0x1A2B3C4D;
constexpr std::uint16_t kNameOption = 2;
/// Type, length, and length again.
constexpr std::uint32_t kBlockFrame = 12;
constexpr std::size_t kMostInterfaces = 256;
/// What is read of an interface's description; the name comes first in all files seen.
constexpr std::size_t kDescriptionRead = 1024;

struct PcapCloser {
  void operator()(pcap_t* capture) const { pcap_close(capture); }
};
using PcapHandle = std::unique_ptr<pcap_t, PcapCloser>;

class AnyClassicCapture final : public CaptureReader {
 public:
  explicit AnyClassicCapture(PcapHandle capture) : capture_(std::move(capture)) {}

  CaptureRead next(CapturedFrame& frame) override {
    pcap_pkthdr* header = nullptr;
    const std::uint8_t* bytes = nullptr;
    const int result = pcap_next_ex(capture_.get(), &header, &bytes);
    if (result == PCAP_ERROR_BREAK) return CaptureRead::kEnd;
    if (result != 1) {
      const bool truncated = std::strstr(pcap_geterr(capture_.get()), "truncated") != nullptr;
      return truncated ? CaptureRead::kTruncated : CaptureRead::kDamaged;
    }
    frame.link_type = pcap_datalink(capture_.get());
    // The capture was opened with nanoseconds, so tv_usec counts those.
    frame.stamp_ns = static_cast<std::int64_t>(header->ts.tv_sec) * 1'000'000'000 + header->ts.tv_usec;
    frame.bytes = {bytes, header->caplen};
    frame.is_cut = header->caplen < header->len;
    return CaptureRead::kFrame;
  }
  [[nodiscard]] std::string problem() const override { return pcap_geterr(capture_.get()); }

 private:
  PcapHandle capture_;
};

}  // namespace

core::Result<std::unique_ptr<CaptureReader>> open_any_classic_capture(FileHandle file) {
  std::array<char, PCAP_ERRBUF_SIZE> message{};
  PcapHandle capture(
      pcap_fopen_offline_with_tstamp_precision(file.get(), PCAP_TSTAMP_PRECISION_NANO, message.data()));
  if (!capture) {
    return core::Error{std::string("is no capture that can be read (") + message.data() +
                       "); expected pcap or pcapng as tcpdump or Wireshark write them, uncompressed"};
  }
  // libpcap closes it from now on.
  static_cast<void>(file.release());
  const int link_type = pcap_datalink(capture.get());
  if (!may_carry_can(link_type)) {
    return core::Error{"is a capture of link type " + link_type_name(link_type) +
                       ", which carries no CAN frames; record on the CAN interface or with '-i any'"};
  }
  return std::unique_ptr<CaptureReader>(std::make_unique<AnyClassicCapture>(std::move(capture)));
}

bool PcapngInterfaces::read(std::uint8_t* bytes, std::size_t size) {
  return std::fread(bytes, 1, size, file_.get()) == size;
}

/// 2 or 4 bytes in the section's order.
std::uint32_t PcapngInterfaces::number(const std::uint8_t* bytes, std::size_t size) const {
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < size; ++i) value = (value << 8U) | bytes[big_endian_ ? i : size - 1 - i];
  return value;
}

CaptureInterface PcapngInterfaces::next() {
  std::array<std::uint8_t, 12> head{};
  while (read(head.data(), 8)) {
    const long body_begin = std::ftell(file_.get());
    const std::uint32_t type = number(head.data(), 4);
    if (type == kSectionHeader) {
      if (!read(head.data() + 8, 4)) break;
      big_endian_ = false;
      big_endian_ = number(head.data() + 8, 4) != kByteOrderMagic;
      names_.clear();
    }
    const std::uint32_t length = number(head.data() + 4, 4);
    if (length < kBlockFrame) break;
    const std::uint32_t body_size = length - kBlockFrame;
    CaptureInterface result{{}, big_endian_};
    bool is_packet = type == kSimplePacket;
    std::uint32_t interface = 0;
    if (type == kInterfaceDescription) add_interface(body_size);
    if (type == kEnhancedPacket || type == kObsoletePacket) {
      is_packet = true;
      const std::size_t size = type == kEnhancedPacket ? 4 : 2;
      if (body_size >= size && read(head.data(), size)) interface = number(head.data(), size);
    }
    if (interface < names_.size()) result.name = names_[interface];
    const long end = body_begin + static_cast<long>(body_size) + 4;
    if (std::fseek(file_.get(), end, SEEK_SET) != 0) break;
    if (is_packet) return result;
  }
  return {{}, big_endian_};
}

void PcapngInterfaces::add_interface(std::size_t body_size) {
  if (names_.size() == kMostInterfaces) return;
  std::string& name = names_.emplace_back();
  std::array<std::uint8_t, kDescriptionRead> body{};
  const std::size_t size = std::min(body_size, body.size());
  if (size < 8 || !read(body.data(), size)) return;
  // After link type and snap length come the options: code, length, and the value in whole words.
  for (std::size_t at = 8; at + 4 <= size;) {
    const std::uint32_t code = number(body.data() + at, 2);
    const std::uint32_t length = number(body.data() + at + 2, 2);
    at += 4;
    if (code == 0 || at + length > size) return;
    if (code == kNameOption) {
      name.assign(body.begin() + static_cast<std::ptrdiff_t>(at),
                  body.begin() + static_cast<std::ptrdiff_t>(at + length));
      name.resize(std::min(name.size(), name.find('\0')));
      return;
    }
    at += (length + 3) / 4 * 4;
  }
}

}  // namespace nilio::drivers
