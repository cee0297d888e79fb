#pragma once

#include "nilio/core/time.hpp"
#include "nilio/drivers/packet.hpp"

#include <cstdint>
#include <optional>

namespace nilio::tools {

/// Moves the sensor's clock in data packets (1206 bytes) and position packets (512 bytes) to the present: the
/// microseconds past the hour of the first packet become those of the host, and all others move by as much,
/// modulo one hour. Other payloads stay as they are. One thread.
class Restamper {
 public:
  /// `host_now`: UTC, used for the first packet only.
  void apply(drivers::Packet& packet, core::Time host_now);
  /// The next packet is a first one again.
  void begin_again() { offset_us_.reset(); }

 private:
  std::optional<std::uint64_t> offset_us_;
};

}  // namespace nilio::tools
