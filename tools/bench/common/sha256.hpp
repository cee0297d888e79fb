#pragma once

#include <array>
#include <cstddef>
#include <openssl/sha.h>
#include <string>
#include <string_view>

namespace nilio::tools::bench {

/// SHA-256 of the bytes as 64 hexadecimal digits, as sha256sum prints it. Identifies a trajectory in reports.
inline std::string sha256(std::string_view bytes) {
  std::array<unsigned char, SHA256_DIGEST_LENGTH> digest{};
  SHA256(reinterpret_cast<const unsigned char*>(bytes.data()), bytes.size(), digest.data());
  constexpr std::string_view digits = "0123456789abcdef";
  std::string text;
  for (const unsigned char byte : digest) {
    text += digits[byte >> 4U];
    text += digits[byte & 15U];
  }
  return text;
}

}  // namespace nilio::tools::bench
