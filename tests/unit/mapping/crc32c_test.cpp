#include "mapping/crc32c.hpp"

#include <string_view>
#include <vector>

#include <catch2/catch.hpp>

namespace {

std::uint32_t crc_of(std::string_view text, std::uint32_t before = 0) {
  return nilio::mapping::crc32c({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()}, before);
}

}  // namespace

TEST_CASE("CRC-32C has the published check values", "[crc32c]") {
  CHECK(crc_of("123456789") == 0xE3069283);
  CHECK(crc_of("") == 0);
  // RFC 3720, B.4: 32 bytes of zeros, of ones, and counting up.
  CHECK(crc_of(std::string(32, '\0')) == 0x8A9136AA);
  CHECK(crc_of(std::string(32, '\xFF')) == 0x62A8AB43);
  std::string counting;
  for (int i = 0; i < 32; ++i) counting += static_cast<char>(i);
  CHECK(crc_of(counting) == 0x46DD794E);
}

TEST_CASE("a checksum continues over parts of any length", "[crc32c]") {
  const std::string text = "the quick brown fox jumps over the lazy dog";
  for (std::size_t cut = 0; cut <= text.size(); ++cut)
    CHECK(crc_of(text.substr(cut), crc_of(text.substr(0, cut))) == crc_of(text));
}
