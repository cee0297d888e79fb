#pragma once

#include <cstddef>
#include <cstdint>
#include <random>
#include <vector>

namespace nilio::fuzz {

using Datagram = std::vector<std::uint8_t>;

/// Damages copies of recorded RTPS datagrams. The same seed and recording give the same datagrams.
class Mutator {
 public:
  /// `recording` must not be empty and outlive the mutator.
  Mutator(const std::vector<Datagram>& recording, std::uint64_t seed)
      : recording_(recording), random_(seed) {}

  /// A recorded datagram with one to four damages.
  Datagram next();

 private:
  std::size_t below(std::size_t limit) { return limit == 0 ? 0 : random_() % limit; }
  /// Begin of a random submessage; the length of the datagram if there is none.
  std::size_t submessage(const Datagram& datagram);
  void damage(Datagram& datagram);

  const std::vector<Datagram>& recording_;
  std::mt19937_64 random_;
};

}  // namespace nilio::fuzz
