#pragma once

#include "tests/support/drivers_support.hpp"
#include "tests/support/tools/run_command.hpp"
#include "tools/commands/commands.hpp"
#include "tools/inspect/recording.hpp"

#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace nilio::tests {

inline constexpr std::uint32_t kFirstSensor = 0xC0A801C9;   // 192.168.1.201
inline constexpr std::uint32_t kSecondSensor = 0xC0A801CA;  // 192.168.1.202

/// Builds an Ethernet capture in memory, from any sender.
class CaptureBuilder {
 public:
  CaptureBuilder() {
    for (const std::uint32_t word : {0xA1B23C4DU, 0x00040002U, 0U, 0U, 0x40000U, 1U}) little(word, 4);
  }

  void udp(std::int64_t stamp_ns, std::uint32_t address, std::uint16_t port,
           std::span<const std::uint8_t> payload) {
    begin_frame(stamp_ns, 42 + payload.size(), 0x0800);
    for (const std::uint32_t byte : {0x45U, 0U}) big(byte, 1);
    big(static_cast<std::uint32_t>(28 + payload.size()), 2);
    for (const std::uint32_t word : {0U, 0x40110000U, address, 0xFFFFFFFFU}) big(word, 4);
    big(port, 2);
    big(port, 2);
    big(static_cast<std::uint32_t>(8 + payload.size()), 2);
    big(0, 2);
    bytes_.append(payload.begin(), payload.end());
  }

  /// A frame of another protocol (ARP is 0x0806).
  void frame(std::int64_t stamp_ns, std::uint16_t ether_type) {
    begin_frame(stamp_ns, 60, ether_type);
    bytes_.append(46, '\0');
  }

  [[nodiscard]] const std::string& bytes() const { return bytes_; }

 private:
  void begin_frame(std::int64_t stamp_ns, std::size_t length, std::uint16_t ether_type) {
    little(static_cast<std::uint32_t>(stamp_ns / 1'000'000'000), 4);
    little(static_cast<std::uint32_t>(stamp_ns % 1'000'000'000), 4);
    for (int i = 0; i < 2; ++i) little(static_cast<std::uint32_t>(length), 4);
    bytes_.append(12, '\x02');
    big(ether_type, 2);
  }
  void little(std::uint32_t value, int size) {
    for (int i = 0; i < size; ++i) bytes_.push_back(static_cast<char>(value >> (8 * i) & 0xFFU));
  }
  void big(std::uint32_t value, int size) {
    for (int i = size - 1; i >= 0; --i) bytes_.push_back(static_cast<char>(value >> (8 * i) & 0xFFU));
  }

  std::string bytes_;
};

inline std::span<const std::uint8_t> payload_of(const drivers::Packet& packet) {
  return std::span(packet.data).first(packet.size);
}

/// Contents of a file of these bytes.
inline tools::inspect::RecordingFindings inspect_bytes(const std::string& bytes, const std::string& suffix) {
  const TemporaryFile file(bytes, suffix);
  return tools::inspect::inspect_recording({file.path()});
}

/// "nilio inspect <arguments>".
inline CommandResult run_inspect(const std::string& arguments) {
  return capture_command(tools::add_inspect_command, "inspect " + arguments);
}

}  // namespace nilio::tests
