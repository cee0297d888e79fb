#pragma once

#include "nilio/drivers/packet.hpp"
#include "nilio/drivers/velodyne/model.hpp"

#include <optional>
#include <span>
#include <string>
#include <vector>

namespace nilio::drivers {

/// Result of detect_velodyne().
struct VelodyneDetection {
  /// Models that match the packets, the most likely first; empty when none does.
  std::vector<VelodyneModel> candidates;
  /// The first candidate, unless others are as likely (VLP-32A and VLP-32B are indistinguishable).
  std::optional<VelodyneModel> model;
  ReturnMode mode = ReturnMode::kSingle;
  /// Median time between packets by the sensor's clock; 0 without one.
  double packet_period_us = 0.0;
  /// For the user: the factory bytes, period and flags of the packets.
  std::string evidence;

  [[nodiscard]] bool agrees_with(VelodyneModel wanted) const;
};

/// Detects the model from factory bytes, block flags and the time between packets. The bytes alone are not
/// reliable: early VLP-16 have those of an HDL-32E, and the HDL-64E has a status stream there. Packets of
/// other sizes are ignored; a few dozen packets of one sensor are enough.
VelodyneDetection detect_velodyne(std::span<const Packet> packets);

}  // namespace nilio::drivers
