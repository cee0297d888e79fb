#pragma once

#include "nilio/drivers/packet.hpp"
#include "nilio/drivers/velodyne/model.hpp"

#include <optional>
#include <span>
#include <string>
#include <vector>

namespace nilio::drivers {

/// What a few packets of one sensor tell about it.
struct VelodyneDetection {
  /// Models that the packets agree with, the most likely first; empty when they agree with none.
  std::vector<VelodyneModel> candidates;
  /// The first candidate, unless others are as likely (a VLP-32A and a VLP-32B cannot be told apart).
  std::optional<VelodyneModel> model;
  ReturnMode mode = ReturnMode::kSingle;
  /// Median time from packet to packet by the sensor's clock, 0 when there is none.
  double packet_period_us = 0.0;
  /// For people: which factory bytes, period and flags were seen.
  std::string evidence;

  [[nodiscard]] bool agrees_with(VelodyneModel wanted) const;
};

/// Tells the model from factory bytes, block flags and the time between packets. The bytes are not trusted
/// alone: early VLP-16 call themselves HDL-32E, and the HDL-64E has a status stream there. Packets of other
/// sizes are passed over; a few dozen packets of one sensor are enough.
VelodyneDetection detect_velodyne(std::span<const Packet> packets);

}  // namespace nilio::drivers
