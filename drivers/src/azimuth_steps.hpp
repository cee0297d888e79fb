#pragma once

#include "nilio/drivers/velodyne_model.hpp"

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
  std::uint32_t bad_blocks = 0;
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
  explicit AzimuthReader(const VelodyneSensor& sensor);

  /// `payload` has kDataPacketSize bytes.
  PacketAzimuths read(std::span<const std::uint8_t> payload);

 private:
  void read_steps(std::span<const std::uint8_t> payload, PacketAzimuths& out) const;
  float rate_of(const PacketAzimuths& azimuths);
  void drop_outliers(PacketAzimuths& out) const;
  void find_pauses(PacketAzimuths& out) const;

  std::array<std::uint16_t, kBlocksPerPacket> flags_;
  std::size_t blocks_per_azimuth_;
  std::int64_t azimuth_period_ns_;
  float largest_rate_;
  float rate_ = 0.0F;
  int doubtful_packets_ = 0;
};

}  // namespace nilio::drivers
