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
  /// The first candidate, unless the packets of others with another decoding are as likely (VLP-32A,
  /// VLP-32B).
  std::optional<VelodyneModel> model;
  ReturnMode mode = ReturnMode::kSingle;
  /// The blocks of the packets show `mode`; they do not while the motor is stopped.
  bool mode_known = false;
  /// Time between packets by the sensor's clock; 0 without one.
  double packet_period_us = 0.0;
  /// Why `model` is a guess, for the user; empty when the packets identify it.
  std::string uncertainty;
  /// For the user: the factory bytes, period and flags of the packets.
  std::string evidence;

  [[nodiscard]] bool agrees_with(VelodyneModel wanted) const;
};

/// Detects the model from block flags, the time of an azimuth step and factory bytes. The bytes alone are not
/// reliable: early VLP-16 have those of an HDL-32E, and the HDL-64E has a status stream there. Packets may be
/// lost, duplicated and out of order: copies are removed, the rest is sorted by the sensor's clock, and the
/// time of an azimuth step follows from the rotation, which lost packets do not change. Packets of other
/// sizes are ignored; a few dozen packets of one sensor are enough.
VelodyneDetection detect_velodyne(std::span<const Packet> packets);

}  // namespace nilio::drivers
