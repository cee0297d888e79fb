#include "nilio/core/units.hpp"
#include "nilio/drivers/capture/capture_reader.hpp"

#include "drivers/common/byte_order.hpp"

#include <algorithm>
#include <array>
#include <optional>
#include <vector>

#include <pcap/dlt.h>

namespace nilio::drivers {
namespace {

using core::Error;

constexpr std::uint32_t kSectionHeader = 0x0A0D0D0A;
constexpr std::uint32_t kInterfaceDescription = 1;
constexpr std::uint32_t kObsoletePacket = 2;
constexpr std::uint32_t kSimplePacket = 3;
constexpr std::uint32_t kEnhancedPacket = 6;
constexpr std::uint32_t kByteOrderMagic = 0x1A2B3C4D;
constexpr std::uint16_t kNameOption = 2;
constexpr std::uint16_t kResolutionOption = 9;
constexpr std::uint16_t kOffsetOption = 14;
constexpr std::uint16_t kRawIpInFiles = 101;
/// Type, length, and length again.
constexpr std::uint32_t kBlockFrame = 12;
/// Size of the block buffer, the same as libpcap's; the rest of longer packets is skipped.
constexpr std::size_t kBuffer = 262'144 + 64;
constexpr std::size_t kMostInterfaces = 256;
/// Largest number of seconds whose nanoseconds fit int64.
constexpr std::int64_t kLargestSeconds = 9'000'000'000;

std::uint64_t power_of_ten(unsigned exponent) {
  std::uint64_t power = 1;
  for (unsigned i = 0; i < exponent; ++i) power *= 10;
  return power;
}

/// Time base of an interface: 10^exponent or 2^exponent ticks per second, and an offset.
struct PcapngClock {
  bool binary = false;
  unsigned exponent = 6;
  std::int64_t offset_s = 0;

  /// Sets the resolution option's byte (if_tsresol); false when a second of such ticks exceeds 64 bits.
  bool set_resolution(std::uint8_t option) {
    binary = (option & 0x80) != 0;
    exponent = option & 0x7FU;
    return exponent <= (binary ? 63U : 19U);
  }

  /// Nanoseconds since 1970, finer parts cut off; nothing when they do not fit int64.
  [[nodiscard]] std::optional<std::int64_t> time_ns(std::uint64_t ticks) const {
    const std::uint64_t rate = binary ? std::uint64_t{1} << exponent : power_of_ten(exponent);
    const std::uint64_t whole = ticks / rate;
    const bool fits = whole <= static_cast<std::uint64_t>(kLargestSeconds) && offset_s >= -kLargestSeconds &&
                      offset_s <= kLargestSeconds;
    if (!fits) return std::nullopt;
    const std::int64_t seconds = static_cast<std::int64_t>(whole) + offset_s;
    if (seconds > kLargestSeconds) return std::nullopt;
    return seconds * kNanosecondsPerSecond + static_cast<std::int64_t>(fraction_ns(ticks % rate));
  }

 private:
  [[nodiscard]] std::uint64_t fraction_ns(std::uint64_t fraction) const {
    if (!binary) {
      return exponent <= 9 ? fraction * power_of_ten(9 - exponent) : fraction / power_of_ten(exponent - 9);
    }
    // Bits beyond the 30th are below a nanosecond and would overflow the product.
    const unsigned bits = std::min(exponent, 30U);
    return ((fraction >> (exponent - bits)) * static_cast<std::uint64_t>(kNanosecondsPerSecond)) >> bits;
  }
};

struct Interface {
  int link_type = 0;
  std::uint32_t snap_length = 0;
  /// Empty when its resolution is invalid.
  std::optional<PcapngClock> clock;
  std::string name;
};

class PcapngCapture final : public CaptureReader {
 public:
  explicit PcapngCapture(FileHandle file) : file_(std::move(file)), buffer_(kBuffer) {}

  CaptureRead next(CapturedFrame& frame) override;
  [[nodiscard]] std::string problem() const override { return problem_; }

 private:
  using Bytes = std::span<const std::uint8_t>;

  /// Numbers at the front of `bytes`, which must hold them, in the section's byte order.
  [[nodiscard]] std::uint16_t u16(Bytes bytes) const {
    return big_endian_ ? load_be16(bytes.data()) : load_le16(bytes.data());
  }
  [[nodiscard]] std::uint32_t u32(Bytes bytes) const {
    return big_endian_ ? load_be32(bytes.data()) : load_le32(bytes.data());
  }
  [[nodiscard]] std::uint64_t u64(Bytes bytes) const {
    return big_endian_ ? load_be64(bytes.data()) : load_le64(bytes.data());
  }

  bool read(std::span<std::uint8_t> bytes);
  bool skip(std::uint64_t count);
  CaptureRead damaged(const std::string& what);
  CaptureRead read_block(std::uint32_t& type, Bytes& body);
  std::optional<CaptureRead> begin_section(std::span<std::uint8_t> head);
  CaptureRead use_block(std::uint32_t type, Bytes body, CapturedFrame& frame);
  CaptureRead add_interface(Bytes body);
  void read_options(Bytes options, Interface& interface) const;
  CaptureRead read_packet(Bytes body, std::uint32_t interface, CapturedFrame& frame);
  void fill(const Interface& interface, std::int64_t stamp_ns, Bytes data, std::size_t original,
            CapturedFrame& frame);
  CaptureRead read_simple_packet(Bytes body, CapturedFrame& frame);

  FileHandle file_;
  std::vector<std::uint8_t> buffer_;
  std::uint64_t position_ = 0;
  std::uint64_t block_position_ = 0;
  bool big_endian_ = false;
  std::array<Interface, kMostInterfaces> interfaces_{};
  std::size_t interface_count_ = 0;
  std::int64_t last_stamp_ns_ = 0;
  std::string problem_;
};

bool PcapngCapture::read(std::span<std::uint8_t> bytes) {
  const std::size_t count = std::fread(bytes.data(), 1, bytes.size(), file_.get());
  position_ += count;
  return count == bytes.size();
}

bool PcapngCapture::skip(std::uint64_t count) {
  std::array<std::uint8_t, 4096> scratch{};
  while (count > 0) {
    const std::size_t part = std::min<std::uint64_t>(count, scratch.size());
    if (!read(std::span(scratch).first(part))) return false;
    count -= part;
  }
  return true;
}

CaptureRead PcapngCapture::damaged(const std::string& what) {
  problem_ = what + " at byte " + std::to_string(block_position_) +
             "; the file is damaged from there on, everything before was read";
  return CaptureRead::kDamaged;
}

CaptureRead PcapngCapture::next(CapturedFrame& frame) {
  for (;;) {
    std::uint32_t type = 0;
    Bytes body;
    if (const CaptureRead block = read_block(type, body); block != CaptureRead::kFrame) return block;
    const CaptureRead used = use_block(type, body, frame);
    // use_block() returns kEnd for blocks without a packet.
    if (used != CaptureRead::kEnd) return used;
  }
}

/// Returns kFrame for a complete block; `body` is as much of it as the buffer holds.
CaptureRead PcapngCapture::read_block(std::uint32_t& type, Bytes& body) {
  block_position_ = position_;
  std::array<std::uint8_t, 12> head{};
  if (!read(std::span(head).first(8))) {
    return position_ == block_position_ ? CaptureRead::kEnd : CaptureRead::kTruncated;
  }
  type = u32(head);
  std::size_t inside = 0;
  if (type == kSectionHeader) {
    if (const auto problem = begin_section(head)) return *problem;
    inside = 4;
  }
  const std::uint32_t length = u32(std::span(head).subspan(4));
  if (length < kBlockFrame + inside || length % 4 != 0) {
    return damaged("a block of " + std::to_string(length) + " bytes");
  }
  const std::size_t rest = length - kBlockFrame - inside;
  const std::size_t kept = std::min(rest, buffer_.size());
  std::array<std::uint8_t, 4> again{};
  if (!read(std::span(buffer_).first(kept)) || !skip(rest - kept) || !read(again)) {
    return CaptureRead::kTruncated;
  }
  if (u32(again) != length) return damaged("a block with two different lengths");
  body = std::span(buffer_).first(kept);
  return CaptureRead::kFrame;
}

/// Reads the byte order, which also holds for the length before it; returns an error or nothing.
std::optional<CaptureRead> PcapngCapture::begin_section(std::span<std::uint8_t> head) {
  if (!read(head.subspan(8, 4))) return CaptureRead::kTruncated;
  big_endian_ = false;
  if (u32(head.subspan(8)) != kByteOrderMagic) {
    big_endian_ = true;
    if (u32(head.subspan(8)) != kByteOrderMagic) return damaged("a section without its byte-order mark");
  }
  interface_count_ = 0;
  return std::nullopt;
}

CaptureRead PcapngCapture::use_block(std::uint32_t type, Bytes body, CapturedFrame& frame) {
  switch (type) {
    case kSectionHeader:
      if (body.size() >= 2 && u16(body) == 1) return CaptureRead::kEnd;
      return damaged("a section of an unknown version of pcapng");
    case kInterfaceDescription:
      return add_interface(body);
    case kEnhancedPacket:
      return body.size() < 20 ? CaptureRead::kSkipped : read_packet(body, u32(body), frame);
    case kObsoletePacket:
      return body.size() < 20 ? CaptureRead::kSkipped : read_packet(body, u16(body), frame);
    case kSimplePacket:
      return read_simple_packet(body, frame);
    default:
      return CaptureRead::kEnd;
  }
}

CaptureRead PcapngCapture::add_interface(Bytes body) {
  if (body.size() < 8) return damaged("a short description of an interface");
  if (interface_count_ == interfaces_.size()) {
    return damaged("more than " + std::to_string(interfaces_.size()) + " interfaces");
  }
  Interface& interface = interfaces_[interface_count_++];
  const std::uint16_t link_type = u16(body);
  // The only supported link type whose number in files differs from libpcap's DLT value.
  interface.link_type = link_type == kRawIpInFiles ? DLT_RAW : link_type;
  interface.snap_length = u32(body.subspan(4));
  interface.clock = PcapngClock{};
  interface.name.clear();
  read_options(body.subspan(8), interface);
  return CaptureRead::kEnd;
}

void PcapngCapture::read_options(Bytes options, Interface& interface) const {
  while (options.size() >= 4) {
    const std::uint16_t code = u16(options);
    const std::size_t length = u16(options.subspan(2));
    const std::size_t padded = (length + 3) / 4 * 4;
    options = options.subspan(4);
    if (code == 0 || options.size() < padded) return;
    if (code == kResolutionOption && length == 1 && interface.clock &&
        !interface.clock->set_resolution(options[0])) {
      interface.clock.reset();
    }
    if (code == kOffsetOption && length == 8 && interface.clock) {
      interface.clock->offset_s = static_cast<std::int64_t>(u64(options));
    }
    if (code == kNameOption) {
      interface.name.assign(options.begin(), options.begin() + static_cast<std::ptrdiff_t>(length));
      interface.name.resize(std::min(interface.name.size(), interface.name.find('\0')));
    }
    options = options.subspan(padded);
  }
}

void PcapngCapture::fill(const Interface& interface, std::int64_t stamp_ns, Bytes data, std::size_t original,
                         CapturedFrame& frame) {
  last_stamp_ns_ = stamp_ns;
  frame.link_type = interface.link_type;
  frame.stamp_ns = stamp_ns;
  frame.bytes = data;
  frame.is_cut = data.size() < original;
  frame.interface_name = interface.name;
  frame.big_endian_host = big_endian_;
}

/// Reads an enhanced or an obsolete packet block: both have time, lengths and data in the same place.
CaptureRead PcapngCapture::read_packet(Bytes body, std::uint32_t interface, CapturedFrame& frame) {
  if (interface >= interface_count_ || !interfaces_[interface].clock) return CaptureRead::kSkipped;
  const std::uint64_t ticks = (std::uint64_t{u32(body.subspan(4))} << 32) | u32(body.subspan(8));
  const auto stamp_ns = interfaces_[interface].clock->time_ns(ticks);
  if (!stamp_ns) return CaptureRead::kSkipped;
  const std::size_t captured = u32(body.subspan(12));
  const std::size_t original = u32(body.subspan(16));
  const Bytes data = body.subspan(20);
  fill(interfaces_[interface], *stamp_ns, data.first(std::min(captured, data.size())), original, frame);
  return CaptureRead::kFrame;
}

/// Simple packets have no time stamp: they get that of the previous packet.
CaptureRead PcapngCapture::read_simple_packet(Bytes body, CapturedFrame& frame) {
  if (body.size() < 4 || interface_count_ == 0) return CaptureRead::kSkipped;
  const std::size_t original = u32(body);
  const std::size_t snap_length = interfaces_[0].snap_length;
  const Bytes data = body.subspan(4);
  const std::size_t captured = snap_length == 0 ? original : std::min(original, snap_length);
  fill(interfaces_[0], last_stamp_ns_, data.first(std::min(captured, data.size())), original, frame);
  return CaptureRead::kFrame;
}

}  // namespace

core::Result<std::unique_ptr<CaptureReader>> open_pcapng_capture(FileHandle file) {
  std::array<std::uint8_t, 4> type{};
  const std::size_t count = std::fread(type.data(), 1, type.size(), file.get());
  constexpr std::array<std::uint8_t, 4> kExpected{0x0A, 0x0D, 0x0D, 0x0A};
  if (count != type.size() || type != kExpected || std::fseek(file.get(), 0, SEEK_SET) != 0) {
    return Error{
        "is no capture (it begins like pcapng, but is not); expected pcap or pcapng "
        "as tcpdump or Wireshark write them, uncompressed"};
  }
  return std::unique_ptr<CaptureReader>(std::make_unique<PcapngCapture>(std::move(file)));
}

}  // namespace nilio::drivers
