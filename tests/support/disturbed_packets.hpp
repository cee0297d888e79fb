#pragma once

#include "nilio/drivers/packet.hpp"

#include <algorithm>
#include <cstdint>
#include <random>
#include <string>
#include <vector>

namespace nilio::tests {

/// Faults of a network, applied to the packets of a recording. Packets are delayed: none arrives before it
/// was sent.
struct Disturbance {
  std::string name;
  /// Share of lost packets.
  double lost = 0.0;
  /// Every packet arrives twice, as from a mirror port.
  bool duplicated = false;
  /// 1: neighbours swapped; more: drawn anew within so many packets.
  std::size_t reordered = 0;
};

inline std::vector<Disturbance> disturbances() {
  return {{"as is", 0.0, false, 0},
          {"duplicated", 0.0, true, 0},
          {"swapped", 0.0, false, 1},
          {"25 % lost", 0.25, false, 0},
          {"40 % lost", 0.4, false, 0},
          {"reordered within 5", 0.0, false, 5},
          {"duplicated, swapped", 0.0, true, 1},
          {"40 % lost, duplicated", 0.4, true, 0},
          {"25 % lost, duplicated, reordered within 5", 0.25, true, 5},
          {"40 % lost, reordered within 5", 0.4, false, 5}};
}

inline std::vector<drivers::Packet> disturb(const std::vector<drivers::Packet>& packets,
                                            const Disturbance& how, std::uint32_t seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  std::vector<drivers::Packet> result;
  for (const drivers::Packet& packet : packets) {
    if (uniform(random) < how.lost) continue;
    result.push_back(packet);
    if (how.duplicated) result.push_back(packet);
  }
  if (how.reordered == 1) {
    for (std::size_t i = 1; i < result.size(); i += 2) std::swap(result[i - 1], result[i]);
  } else {
    for (std::size_t i = 0; how.reordered > 0 && i + how.reordered <= result.size(); i += how.reordered) {
      const auto first = result.begin() + static_cast<std::ptrdiff_t>(i);
      std::shuffle(first, first + static_cast<std::ptrdiff_t>(how.reordered), random);
    }
  }
  for (std::size_t i = 1; i < result.size(); ++i)
    result[i].stamp = std::max(result[i].stamp, result[i - 1].stamp);
  return result;
}

}  // namespace nilio::tests
