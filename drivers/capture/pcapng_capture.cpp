#include "nilio/drivers/capture/capture_reader.hpp"

#include "drivers/capture/pcapng_time.hpp"

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
/// What a block is read into; of longer packets the rest is passed over. As much as libpcap reads.
constexpr std::size_t kBuffer = 262'144 + 64;
constexpr std::size_t kMostInterfaces = 256;

struct Interface {
  int link_type = 0;
  std::uint32_t snap_length = 0;
  /// Nothing when its resolution is one that cannot be.
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

  /// Numbers at the front of `bytes`, which must be there.
  [[nodiscard]] std::uint16_t u16(Bytes bytes) const {
    return static_cast<std::uint16_t>(big_endian_ ? (bytes[0] << 8) | bytes[1] : bytes[0] | (bytes[1] << 8));
  }
  [[nodiscard]] std::uint32_t u32(Bytes bytes) const {
    const std::uint32_t first = u16(bytes);
    const std::uint32_t second = u16(bytes.subspan(2));
    return big_endian_ ? (first << 16) | second : first | (second << 16);
  }
  [[nodiscard]] std::uint64_t u64(Bytes bytes) const {
    const std::uint64_t first = u32(bytes);
    const std::uint64_t second = u32(bytes.subspan(4));
    return big_endian_ ? (first << 32) | second : first | (second << 32);
  }

  bool read(std::span<std::uint8_t> bytes);
  bool pass_over(std::uint64_t count);
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

bool PcapngCapture::pass_over(std::uint64_t count) {
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
    // Blocks that are no packets: kEnd says "nothing in here".
    if (used != CaptureRead::kEnd) return used;
  }
}

/// kFrame when there is a block; `body` is its first part, as far as the buffer takes it.
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
  if (!read(std::span(buffer_).first(kept)) || !pass_over(rest - kept) || !read(again)) {
    return CaptureRead::kTruncated;
  }
  if (u32(again) != length) return damaged("a block with two different lengths");
  body = std::span(buffer_).first(kept);
  return CaptureRead::kFrame;
}

/// Reads the byte order, which holds from the length before it on; nothing when all is well.
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
  // The only one of those read here that files number otherwise than libpcap on this system.
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
    if (code == kResolutionOption && length == 1 && interface.clock) {
      interface.clock = with_resolution(*interface.clock, options[0]);
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

/// An enhanced or an obsolete packet block: both have time, lengths and data in the same place.
CaptureRead PcapngCapture::read_packet(Bytes body, std::uint32_t interface, CapturedFrame& frame) {
  if (interface >= interface_count_ || !interfaces_[interface].clock) return CaptureRead::kSkipped;
  const std::uint64_t ticks = (std::uint64_t{u32(body.subspan(4))} << 32) | u32(body.subspan(8));
  const auto stamp_ns = pcapng_time_ns(ticks, *interfaces_[interface].clock);
  if (!stamp_ns) return CaptureRead::kSkipped;
  const std::size_t captured = u32(body.subspan(12));
  const std::size_t original = u32(body.subspan(16));
  const Bytes data = body.subspan(20);
  fill(interfaces_[interface], *stamp_ns, data.first(std::min(captured, data.size())), original, frame);
  return CaptureRead::kFrame;
}

/// Simple packets have no time of their own: they get that of the packet before.
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
        "is no capture that can be read (it begins like pcapng, but is not); expected pcap or pcapng "
        "as tcpdump or Wireshark write them, uncompressed"};
  }
  return std::unique_ptr<CaptureReader>(std::make_unique<PcapngCapture>(std::move(file)));
}

}  // namespace nilio::drivers
