#pragma once

#include "nilio/drivers/packet.hpp"

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

namespace nilio::daemon {

/// Status byte of an HDL-64E packet.
struct StatusByte {
  std::uint32_t timestamp_us = 0;
  std::uint8_t type = 0;
  std::uint8_t value = 0;
};

/// Puts the packets of a status stream in the order of their time stamps and removes copies. The stream's
/// position is the number of packets, so that each has to be there once.
class StatusStreamOrder {
 public:
  /// `period_us`: time between packets; 0 = the sensor has no clock, packets pass as they arrive.
  explicit StatusStreamOrder(double period_us) : period_us_(period_us) {}

  void add(const drivers::Packet& packet);
  /// Next byte in order, if it is known to be the next one; `after_loss` is set if packets before it are
  /// missing.
  std::optional<StatusByte> next(bool& after_loss);

 private:
  double period_us_;
  /// Waiting bytes, ascending.
  std::vector<StatusByte> waiting_;
  std::optional<std::uint32_t> last_us_;
};

}  // namespace nilio::daemon
