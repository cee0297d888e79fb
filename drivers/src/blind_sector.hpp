#pragma once

#include <cstdint>

namespace nilio::drivers {

/// Learns in which sector a sensor with a restricted field of view does not fire. A gap inside a packet is
/// such a sector for certain; a gap between packets is one when it comes back at the same place.
class BlindSector {
 public:
  /// A gap inside a packet: the sensor did not fire from azimuth `from` to `to` (0.01 degree).
  void see_inside_packet(std::uint16_t from, std::uint16_t to);
  /// A gap between packets in which `packets` would have fitted. True: the sensor does not fire there,
  /// nothing was lost. `wrongly_counted` gets the packets that an earlier call took for lost.
  bool explains(std::uint16_t from, std::uint16_t to, std::uint32_t packets, std::uint32_t& wrongly_counted);
  /// The sensor fired here: a sector that holds it is forgotten.
  void see_firing(std::uint16_t azimuth);
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
  std::uint32_t candidate_packets_ = 0;
};

}  // namespace nilio::drivers
