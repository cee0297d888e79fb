#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <utility>

namespace nilio::tests {

/// Link types as numbered in capture files.
inline constexpr int kLinkNull = 0;
inline constexpr int kLinkEthernet = 1;
inline constexpr int kLinkRaw = 101;
inline constexpr int kLinkLoop = 108;
inline constexpr int kLinkCooked = 113;
inline constexpr int kLinkCan = 227;
inline constexpr int kLinkIpv4 = 228;
inline constexpr int kLinkCooked2 = 276;

/// Bytes with numbers in the selected byte order.
class ByteText {
 public:
  explicit ByteText(bool big_endian) : big_endian_(big_endian) {}

  ByteText& u16(std::uint64_t value) { return number(value, 2); }
  ByteText& u32(std::uint64_t value) { return number(value, 4); }
  ByteText& text(std::string_view bytes) {
    bytes_ += bytes;
    return *this;
  }
  ByteText& pad(std::size_t multiple) {
    while (bytes_.size() % multiple != 0) bytes_ += '\0';
    return *this;
  }
  [[nodiscard]] const std::string& bytes() const { return bytes_; }

 private:
  ByteText& number(std::uint64_t value, int size) {
    for (int i = 0; i < size; ++i) {
      const int shift = 8 * (big_endian_ ? size - 1 - i : i);
      bytes_ += static_cast<char>(static_cast<std::uint8_t>(value >> shift));
    }
    return *this;
  }

  bool big_endian_;
  std::string bytes_;
};

/// An IPv4 packet from 192.168.1.`host` with UDP from and to `port`.
inline std::string ipv4_udp(std::uint16_t port, std::string_view payload, std::uint8_t host = 201,
                            std::uint16_t fragment_field = 0x4000) {
  ByteText ip(true);
  ip.u16(0x4500).u16(28 + payload.size()).u16(0).u16(fragment_field).u16(0x4011).u16(0);
  ip.u32(0xC0A80100U + host).u32(0xFFFFFFFF);
  ip.u16(port).u16(port).u16(8 + payload.size()).u16(0).text(payload);
  return ip.bytes();
}

/// The packet after the header of a link type.
inline std::string link_frame(int link_type, const std::string& ip) {
  ByteText header(true);
  switch (link_type) {
    case kLinkNull:
      return ByteText(false).u32(2).text(ip).bytes();
    case kLinkLoop:
      return header.u32(2).text(ip).bytes();
    case kLinkEthernet:
      return header.text("\xFF\xFF\xFF\xFF\xFF\xFF\x60\x76\x88")
          .text({"\0\0\0", 3})
          .u16(0x0800)
          .text(ip)
          .bytes();
    case kLinkCooked:
      return header.u16(0).u16(1).u16(6).u32(0).u32(0).u16(0x0800).text(ip).bytes();
    case kLinkCooked2:
      return header.u16(0x0800).u16(0).u32(2).u16(1).u16(0x0006).u32(0).u32(0).text(ip).bytes();
    default:
      return ip;
  }
}

/// A classic capture in one of its four forms.
class PcapText {
 public:
  explicit PcapText(int link_type, bool big_endian = false, bool nanoseconds = true)
      : text_(big_endian), nanoseconds_(nanoseconds) {
    text_.u32(nanoseconds ? 0xA1B23C4D : 0xA1B2C3D4).u16(2).u16(4).u32(0).u32(0).u32(65535);
    text_.u32(static_cast<std::uint32_t>(link_type));
  }

  /// `original_length` 0 = captured completely.
  PcapText& packet(std::int64_t stamp_ns, const std::string& frame, std::size_t original_length = 0) {
    const std::int64_t fraction = stamp_ns % 1'000'000'000;
    text_.u32(static_cast<std::uint64_t>(stamp_ns / 1'000'000'000));
    text_.u32(static_cast<std::uint64_t>(nanoseconds_ ? fraction : fraction / 1000));
    text_.u32(frame.size()).u32(original_length == 0 ? frame.size() : original_length).text(frame);
    return *this;
  }
  [[nodiscard]] const std::string& bytes() const { return text_.bytes(); }

 private:
  ByteText text_;
  bool nanoseconds_;
};

/// A pcapng capture, block by block.
class PcapngText {
 public:
  explicit PcapngText(bool big_endian = false) { section(big_endian); }

  PcapngText& section(bool big_endian) {
    big_endian_ = big_endian;
    ByteText body(big_endian);
    return block(0x0A0D0D0A, body.u32(0x1A2B3C4D).u16(1).u16(0).u32(0xFFFFFFFF).u32(0xFFFFFFFF).bytes());
  }
  /// `options` as in the file, without the end mark.
  PcapngText& interface(int link_type, const std::string& options = {}) {
    ByteText body(big_endian_);
    body.u16(static_cast<std::uint32_t>(link_type)).u16(0).u32(0).text(options);
    if (!options.empty()) body.u32(0);
    return block(1, body.bytes());
  }
  [[nodiscard]] std::string option(std::uint16_t code, const std::string& value) const {
    return ByteText(big_endian_).u16(code).u16(value.size()).text(value).pad(4).bytes();
  }
  /// Enhanced packet block; `ticks` in the interface's unit.
  PcapngText& packet(std::uint32_t interface, std::uint64_t ticks, const std::string& frame,
                     std::size_t original_length = 0) {
    ByteText body(big_endian_);
    body.u32(interface).u32(ticks >> 32).u32(ticks).u32(frame.size());
    body.u32(original_length == 0 ? frame.size() : original_length).text(frame).pad(4);
    return block(6, body.bytes());
  }
  PcapngText& simple_packet(const std::string& frame) {
    return block(3, ByteText(big_endian_).u32(frame.size()).text(frame).pad(4).bytes());
  }
  PcapngText& block(std::uint32_t type, const std::string& body) {
    const std::size_t length = body.size() + 12;
    bytes_ += ByteText(big_endian_).u32(type).u32(length).text(body).u32(length).bytes();
    return *this;
  }
  [[nodiscard]] const std::string& bytes() const { return bytes_; }

 private:
  bool big_endian_ = false;
  std::string bytes_;
};

}  // namespace nilio::tests
