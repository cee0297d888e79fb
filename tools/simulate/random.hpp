#pragma once

#include <cmath>
#include <cstdint>
#include <numbers>

namespace nilio::tools::simulate {

/// Finaliser of SplitMix64 (Steele, Lea, Flood 2014): a bijection that spreads every input bit over the whole
/// word.
constexpr std::uint64_t mix_bits(std::uint64_t x) {
  x += 0x9E3779B97F4A7C15U;
  x = (x ^ (x >> 30U)) * 0xBF58476D1CE4E5B9U;
  x = (x ^ (x >> 27U)) * 0x94D049BB133111EBU;
  return x ^ (x >> 31U);
}

/// Counter-based random word: the same for the same key, independent of earlier draws and of the thread.
constexpr std::uint64_t random_word(std::uint64_t seed, std::uint64_t a, std::uint64_t b = 0) {
  return mix_bits(mix_bits(mix_bits(seed) ^ a) ^ b);
}

/// In [0, 1), from the upper 53 bits.
constexpr double to_unit_interval(std::uint64_t word) { return static_cast<double>(word >> 11U) * 0x1.0p-53; }

/// Standard normal deviate (Box-Muller) from one word.
inline double to_gaussian(std::uint64_t word) {
  const double u = 1.0 - to_unit_interval(word);
  const double v = to_unit_interval(mix_bits(word));
  return std::sqrt(-2.0 * std::log(u)) * std::cos(2.0 * std::numbers::pi * v);
}

/// A sequence of random numbers for work that is done in a fixed order. One thread.
class RandomStream {
 public:
  RandomStream(std::uint64_t seed, std::uint64_t stream) : key_(random_word(seed, stream)) {}

  std::uint64_t next() { return mix_bits(key_ ^ mix_bits(++counter_)); }
  double uniform(double low, double high) { return low + (high - low) * to_unit_interval(next()); }
  double gaussian() { return to_gaussian(next()); }
  bool chance(double probability) { return to_unit_interval(next()) < probability; }
  /// As `count` calls of next().
  void skip(std::uint64_t count) { counter_ += count; }
  /// In [0, count).
  std::uint64_t index(std::uint64_t count) { return next() % count; }

 private:
  std::uint64_t key_;
  std::uint64_t counter_ = 0;
};

}  // namespace nilio::tools::simulate
