#pragma once

#include <cstdint>

namespace nilio::drivers {

/// Learns in which sector a sensor with a restricted field of view does not fire. A gap inside a packet is
/// such a sector for certain; a gap between packets is one when it comes back at the same place in three
/// revolutions in a row.
class BlindSector {
 public:
  /// A gap between packets: azimuths (0.01 degree) before and behind it, packets that would have fitted, and
  /// when it was, with the time of a revolution.
  struct Gap {
    std::uint16_t from = 0;
    std::uint16_t to = 0;
    std::uint32_t packets = 0;
    std::int64_t time_ns = 0;
    std::int64_t revolution_ns = 0;
  };

  /// A gap inside a packet: the sensor did not fire from azimuth `from` to `to` (0.01 degree).
  void on_gap_inside_packet(std::uint16_t from, std::uint16_t to);
  /// True: the sensor does not fire there, nothing was lost. `wrongly_counted` gets the packets that earlier
  /// calls took for lost.
  bool explains(const Gap& gap, std::uint32_t& wrongly_counted);
  /// The sensor fired here: a sector that holds it is forgotten.
  void on_firing(std::uint16_t azimuth);
  /// The sensor begins to fire again at about this azimuth.
  [[nodiscard]] bool ends_at(std::uint16_t azimuth) const;
  /// 0 = none.
  [[nodiscard]] double width_deg() const { return known_ ? sector_.width() / 100.0 : 0.0; }

 private:
  struct Sector {
    std::uint16_t from = 0;
    std::uint16_t to = 0;
    [[nodiscard]] int width() const;
    [[nodiscard]] bool is_like(const Sector& other) const;
  };
  Sector sector_;
  bool known_ = false;
  Sector candidate_;
  int candidate_seen_ = 0;
  std::int64_t candidate_time_ns_ = 0;
  std::uint32_t candidate_packets_ = 0;
};

}  // namespace nilio::drivers
