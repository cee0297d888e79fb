#pragma once

#include <cstdint>

namespace nilio::drivers {

/// Estimates the sector in which a sensor with a restricted field of view does not fire. A gap inside a
/// packet is such a sector; a gap between packets is accepted as one when it repeats at the same azimuth in
/// three consecutive revolutions.
class BlindSector {
 public:
  /// A gap between packets: azimuths (0.01 degree) before and after it, number of packets that fit into it,
  /// its time and the duration of a revolution.
  struct Gap {
    std::uint16_t from = 0;
    std::uint16_t to = 0;
    std::uint32_t packets = 0;
    std::int64_t time_ns = 0;
    std::int64_t revolution_ns = 0;
  };

  /// A gap inside a packet: the sensor did not fire from azimuth `from` to `to` (0.01 degree).
  void on_gap_inside_packet(std::uint16_t from, std::uint16_t to);
  /// True when the sensor does not fire there, so that no packet was lost. `wrongly_counted` returns the
  /// packets that earlier calls counted as lost.
  bool explains(const Gap& gap, std::uint32_t& wrongly_counted);
  /// A firing at this azimuth: a sector that contains it is reset.
  void on_firing(std::uint16_t azimuth);
  /// True when the blind sector ends near this azimuth.
  [[nodiscard]] bool ends_at(std::uint16_t azimuth) const;
  [[nodiscard]] bool is_known() const { return known_; }
  /// Last firing before the sector and first one after it, 0.01 degree; valid if known.
  [[nodiscard]] std::uint16_t from() const { return sector_.from; }
  [[nodiscard]] std::uint16_t to() const { return sector_.to; }
  /// Width of the sector, degrees; 0 = none.
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
