#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <span>
#include <string>
#include <sys/mman.h>
#include <unistd.h>

namespace nilio::fuzz {

/// Aborts on a broken invariant, so that the fuzzer keeps the input.
inline void require(bool condition, const char* what) {
  if (condition) return;
  std::fprintf(stderr, "invariant broken: %s\n", what);
  std::abort();
}

/// Takes numbers from the front of the input; zeros after its end.
class ByteReader {
 public:
  explicit ByteReader(std::span<const std::uint8_t> bytes) : bytes_(bytes) {}

  [[nodiscard]] bool empty() const { return bytes_.empty(); }
  std::uint8_t u8() {
    if (bytes_.empty()) return 0;
    const std::uint8_t value = bytes_.front();
    bytes_ = bytes_.subspan(1);
    return value;
  }
  std::uint16_t u16() {
    const std::uint8_t low = u8();
    return static_cast<std::uint16_t>(low | (u8() << 8));
  }
  std::uint32_t u32() {
    const std::uint16_t low = u16();
    return low | (static_cast<std::uint32_t>(u16()) << 16);
  }
  /// Takes up to `count` bytes; fewer at the end.
  std::span<const std::uint8_t> take(std::size_t count) {
    const auto taken = bytes_.first(count < bytes_.size() ? count : bytes_.size());
    bytes_ = bytes_.subspan(taken.size());
    return taken;
  }

 private:
  std::span<const std::uint8_t> bytes_;
};

/// A file in memory with a path, for code that reads files.
class MemoryFile {
 public:
  explicit MemoryFile(std::span<const std::uint8_t> content) : descriptor_(memfd_create("fuzz", 0)) {
    const auto size = static_cast<ssize_t>(content.size());
    require(write(descriptor_, content.data(), content.size()) == size, "memory for the input");
  }
  MemoryFile(const MemoryFile&) = delete;
  MemoryFile& operator=(const MemoryFile&) = delete;
  ~MemoryFile() { close(descriptor_); }
  [[nodiscard]] std::string path() const { return "/proc/self/fd/" + std::to_string(descriptor_); }

 private:
  int descriptor_;
};

/// Format of fuzz_packets' input: model, time source, return mode, returns, cut azimuth (in 360/256 degree),
/// minimum coverage (in 1/256), one byte each, then records that begin with one of these.
enum class PacketRecord : std::uint8_t {
  /// u16 stamp advance (us), u16 length, payload of this length.
  kRaw = 0,
  /// u8 count, u16 azimuth advance per step (0.01 degree), i16 clock error per packet (us): `count`
  /// good packets of a turning sensor.
  kTurn = 1,
  /// u16 offset, u8 value: the last packet again with this byte changed.
  kAgain = 2,
  /// u32 sensor clock (us past the hour), u32 host clock advance (us).
  kClock = 3,
};

}  // namespace nilio::fuzz
