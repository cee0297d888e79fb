#pragma once

#include "nilio/core/time.hpp"
#include "nilio/drivers/velodyne_decoder.hpp"

#include <cstdint>

namespace nilio::drivers {

enum class PacketOrder {
  kNext,       ///< follows the previous packet, or is the first
  kDuplicate,  ///< the previous packet once more
  kReordered,  ///< a little older than the previous
  kJump,       ///< the sensor's or the host's clock was set: the clock has been anchored anew
};

struct PacketArrival {
  PacketOrder order = PacketOrder::kNext;
  /// First firing of the packet on the assembler's time line; to_time() brings it to what goes out.
  std::int64_t first_firing_ns = 0;
  /// Packets missing between the previous one and this.
  std::uint32_t lost = 0;
};

/// Makes a continuous time line of the sensor's microseconds past the hour.
///
/// The counter is continued by differences modulo one hour; which hour it is, the host's stamp says, once, at
/// the first packet. A sensor whose clock is not the host's is shifted by a constant: the smallest difference
/// seen until freeze(), since a packet can only be received late.
class PacketClock {
 public:
  PacketClock(TimeSource source, std::int64_t packet_period_ns)
      : source_(source), packet_period_ns_(packet_period_ns) {}

  /// `previous_pause_ns` is the time the previous packet spent beyond the nominal packet period (a blind
  /// sector).
  PacketArrival arrive(std::uint32_t timestamp_us, std::uint16_t first_azimuth, core::Time stamp,
                       std::int64_t previous_pause_ns);
  [[nodiscard]] core::Time to_time(std::int64_t assembler_ns) const { return {assembler_ns + shift_ns_}; }
  /// From here on the shift is constant.
  void freeze() { shift_open_ = false; }

 private:
  void anchor(std::uint32_t timestamp_us, core::Time stamp);
  void refine_shift(core::Time stamp);
  [[nodiscard]] std::int64_t first_firing_ns(core::Time stamp) const;

  TimeSource source_;
  std::int64_t packet_period_ns_;
  bool anchored_ = false;
  bool shift_open_ = false;
  std::uint32_t last_timestamp_us_ = 0;
  std::uint16_t last_azimuth_ = 0;
  core::Time last_stamp_;
  std::int64_t sensor_ns_ = 0;
  std::int64_t shift_ns_ = 0;
};

}  // namespace nilio::drivers
