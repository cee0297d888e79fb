#pragma once

#include "nilio/drivers/packet.hpp"

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

namespace nilio::drivers {

/// Data packets of a sensor, each once and in the order of the sensor's clock.
struct PacketSample {
  std::vector<const Packet*> packets;
  /// The time stamps advance, so the sensor has a clock; unset for fewer than two different packets. Packets
  /// of a sensor without a clock stay in the order of arrival.
  std::optional<bool> ticks;

  [[nodiscard]] std::span<const std::uint8_t> payload(std::size_t i) const {
    return std::span(packets[i]->data).first(packets[i]->size);
  }
};

/// Removes copies, packets of other sizes and truncated ones. Refers to `packets`.
PacketSample make_sample(std::span<const Packet> packets);

/// Time from one azimuth step to the next, by the sensor's clock; 0 when the motor is stopped, the sensor has
/// no clock, or a packet holds a single step. It is the azimuth between two steps of a packet, divided by the
/// turning rate between packets: neither changes when packets are lost, and of both a robust mean over all
/// packets is taken. `blocks_per_step`: blocks that share an azimuth.
double azimuth_step_us(const PacketSample& sample, std::size_t blocks_per_step);

/// Median time between packets if four of five times are alike; 0 otherwise.
double regular_packet_period_us(const PacketSample& sample);

}  // namespace nilio::drivers
