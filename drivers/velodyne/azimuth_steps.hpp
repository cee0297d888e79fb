#pragma once

#include "nilio/drivers/velodyne/model.hpp"

#include "drivers/velodyne/blind_sector.hpp"

#include <array>
#include <cstdint>
#include <span>

namespace nilio::drivers {

/// One azimuth step of a packet: the blocks that share an azimuth.
struct AzimuthStep {
  bool usable = false;
  std::uint16_t azimuth = 0;
  /// Delay against the nominal time, from a blind sector inside the packet.
  std::int64_t pause_ns = 0;
};

/// Azimuth steps of a packet and the rotation rate.
struct PacketAzimuths {
  std::array<AzimuthStep, kBlocksPerPacket> steps{};
  std::size_t count = 0;
  /// Advance from one step to the next, in 0.01 degree.
  float rate = 0.0F;
  std::uint32_t bad_steps = 0;
  /// First step after a gap inside the packet; 0 = no gap.
  std::size_t gap_from_step = 0;
  /// Pause of the last usable step.
  std::int64_t pause_ns = 0;
};

/// Advance from one azimuth to a later one in 0.01 degree, -100..35899: encoders jitter back a little.
int azimuth_advance(std::uint16_t from, std::uint16_t to);
/// Largest advance between neighbouring steps by rotation; a larger one is a gap.
int largest_regular_advance(float rate);

/// Reads and validates the azimuths of packets. Filters the rotation rate, so that a single bad packet does
/// not change it.
class AzimuthReader {
 public:
  /// `azimuth_period_ns`: time of one azimuth step, the unit of the rate.
  void set_layout(const PacketLayout& layout);
  void set_period(std::int64_t azimuth_period_ns);

  /// `payload` has kDataPacketSize bytes. `since_previous_ns` is the time since the previous packet's stamp,
  /// for packets with a single step; 0 = unknown.
  PacketAzimuths read(std::span<const std::uint8_t> payload, std::int64_t since_previous_ns,
                      const BlindSector& blind);

 private:
  void read_steps(std::span<const std::uint8_t> payload, PacketAzimuths& out) const;
  float advance_per_step(const PacketAzimuths& azimuths, std::int64_t since_previous_ns) const;
  void update_rate(float advance);
  void drop_outliers(PacketAzimuths& out, const BlindSector& blind) const;
  void find_pauses(PacketAzimuths& out) const;

  PacketLayout layout_;
  std::int64_t azimuth_period_ns_ = 1;
  float largest_rate_ = 0.0F;
  float rate_ = 0.0F;
  int unaccepted_packets_ = 0;
  bool has_last_azimuth_ = false;
  std::uint16_t last_azimuth_ = 0;
};

}  // namespace nilio::drivers
