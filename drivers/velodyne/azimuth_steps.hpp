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
  /// Time beyond the nominal one, when the sensor kept silent over a blind sector inside the packet.
  std::int64_t pause_ns = 0;
};

struct PacketAzimuths {
  std::array<AzimuthStep, kBlocksPerPacket> steps{};
  std::size_t count = 0;
  /// Advance from one step to the next, in 0.01 degree.
  float rate = 0.0F;
  std::uint32_t bad_steps = 0;
  /// First step behind a gap inside the packet; 0 = no gap.
  std::size_t gap_from_step = 0;
  /// Of the last usable step.
  std::int64_t pause_ns = 0;
};

/// Advance from one azimuth to a later one in 0.01 degree, -100..35899: encoders jitter back a little.
int azimuth_advance(std::uint16_t from, std::uint16_t to);
/// The largest advance between neighbouring steps that still is rotation and not a gap.
int largest_regular_advance(float rate);

/// Reads and judges the azimuths of packets. Remembers the rotation rate, so that one bad packet does not
/// change it.
class AzimuthReader {
 public:
  /// `azimuth_period_ns` as the rate is counted.
  void set_layout(const PacketLayout& layout);
  void set_period(std::int64_t azimuth_period_ns);

  /// `payload` has kDataPacketSize bytes. `since_previous_ns` is the time from the previous packet's stamp to
  /// this one's, for packets that hold a single step; 0 when unknown.
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
  int doubtful_packets_ = 0;
  bool has_last_azimuth_ = false;
  std::uint16_t last_azimuth_ = 0;
};

}  // namespace nilio::drivers
