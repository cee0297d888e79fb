#include "tools/common/sha256.hpp"

#include <array>
#include <bit>
#include <cstdint>
#include <cstdio>

namespace nilio::tools {

namespace {

constexpr std::size_t kBlockBytes = 64;
using State = std::array<std::uint32_t, 8>;

/// The first primes, whose roots give the constants.
constexpr std::array<std::uint32_t, 64> primes() {
  std::array<std::uint32_t, 64> result{};
  std::size_t count = 0;
  for (std::uint32_t candidate = 2; count < result.size(); ++candidate) {
    bool is_prime = true;
    for (std::size_t i = 0; i < count && is_prime; ++i) is_prime = candidate % result[i] != 0;
    if (is_prime) result[count++] = candidate;
  }
  return result;
}

/// The first 32 bits behind the point of the k-th root of a prime: the greatest r with
/// r^k <= prime * 2^(32 k), less its integer part.
constexpr std::uint32_t root_bits(std::uint32_t prime, int k) {
  std::uint64_t low = 0;
  std::uint64_t high = 1ULL << 36U;
  while (high - low > 1) {
    const std::uint64_t middle = low + (high - low) / 2;
    // 36 bits to the third power need more than 64 bits.
    __extension__ using Wide = unsigned __int128;
    const Wide square = static_cast<Wide>(middle) * middle;
    const bool fits = k == 2 ? square <= static_cast<Wide>(prime) << 64U
                             : square * middle <= static_cast<Wide>(prime) << 96U;
    (fits ? low : high) = middle;
  }
  return static_cast<std::uint32_t>(low);
}

template <std::size_t kCount>
constexpr std::array<std::uint32_t, kCount> roots(int k) {
  std::array<std::uint32_t, kCount> result{};
  constexpr auto kPrimes = primes();
  for (std::size_t i = 0; i < kCount; ++i) result[i] = root_bits(kPrimes[i], k);
  return result;
}

constexpr State kInitial = roots<8>(2);
constexpr std::array<std::uint32_t, 64> kRound = roots<64>(3);

void add_block(std::string_view block, State& state) {
  std::array<std::uint32_t, 64> w{};
  for (std::size_t i = 0; i < kBlockBytes; ++i)
    w[i / 4] = w[i / 4] << 8U | static_cast<unsigned char>(block[i]);
  for (std::size_t i = 16; i < w.size(); ++i) {
    const std::uint32_t a = w[i - 15];
    const std::uint32_t b = w[i - 2];
    w[i] = w[i - 16] + (std::rotr(a, 7) ^ std::rotr(a, 18) ^ a >> 3U) + w[i - 7] +
           (std::rotr(b, 17) ^ std::rotr(b, 19) ^ b >> 10U);
  }
  auto [a, b, c, d, e, f, g, h] = state;
  for (std::size_t i = 0; i < w.size(); ++i) {
    const std::uint32_t choice = (e & f) ^ (~e & g);
    const std::uint32_t t1 =
        h + (std::rotr(e, 6) ^ std::rotr(e, 11) ^ std::rotr(e, 25)) + choice + kRound[i] + w[i];
    const std::uint32_t majority = (a & b) ^ (a & c) ^ (b & c);
    const std::uint32_t t2 = (std::rotr(a, 2) ^ std::rotr(a, 13) ^ std::rotr(a, 22)) + majority;
    h = g;
    g = f;
    f = e;
    e = d + t1;
    d = c;
    c = b;
    b = a;
    a = t1 + t2;
  }
  const State sum{a, b, c, d, e, f, g, h};
  for (std::size_t i = 0; i < sum.size(); ++i) state[i] += sum[i];
}

}  // namespace

std::string sha256(std::string_view bytes) {
  State state = kInitial;
  const std::size_t whole = bytes.size() / kBlockBytes * kBlockBytes;
  for (std::size_t at = 0; at < whole; at += kBlockBytes) add_block(bytes.substr(at, kBlockBytes), state);
  // A one, zeros, and the length in bits fill the last block or two.
  std::string tail(bytes.substr(whole));
  tail += '\x80';
  while (tail.size() % kBlockBytes != kBlockBytes - 8) tail += '\0';
  const std::uint64_t bits = 8 * static_cast<std::uint64_t>(bytes.size());
  for (int shift = 56; shift >= 0; shift -= 8) tail += static_cast<char>(bits >> shift & 0xFFU);
  for (std::size_t at = 0; at < tail.size(); at += kBlockBytes)
    add_block(std::string_view(tail).substr(at, kBlockBytes), state);
  std::string digits;
  for (const std::uint32_t word : state) {
    std::array<char, 9> text{};
    std::snprintf(text.data(), text.size(), "%08x", word);
    digits += text.data();
  }
  return digits;
}

}  // namespace nilio::tools
