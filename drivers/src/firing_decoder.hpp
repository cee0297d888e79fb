#pragma once

#include "nilio/core/scan.hpp"
#include "nilio/drivers/velodyne_model.hpp"

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace nilio::drivers {

/// Turns blocks into points. All that depends on the laser only is in tables, so that a point costs a few
/// nanoseconds.
class FiringDecoder {
 public:
  FiringDecoder(const VelodyneSensor& sensor, double min_range_m, double max_range_m);

  /// Azimuth advance from step to step (0.01 degree) for the packets to come.
  void set_rate(float rate);

  struct Counts {
    std::size_t points = 0;
    std::size_t out_of_range = 0;
  };
  /// Decodes block `index` of a packet into `points` (room for kEntriesPerBlock). `time_ns` is the packet's
  /// time relative to the scan's start. The block's azimuth must be below kAzimuthModulus,
  /// and a byte must follow the block, as the time stamp does at the packet's end.
  Counts decode_block(const std::uint8_t* block, std::size_t index, std::int32_t time_ns,
                      std::span<core::Point> points) const;

  /// First and last firing of an azimuth step, relative to the packet's time.
  [[nodiscard]] std::int32_t first_firing_ns(std::size_t step) const { return first_firing_ns_[step]; }
  [[nodiscard]] std::int32_t last_firing_ns(std::size_t step) const { return last_firing_ns_[step]; }

 private:
  using Row = std::array<float, kEntriesPerBlock>;
  /// For the entries of one of the blocks that share an azimuth.
  struct Lane {
    Row distance_correction{};
    Row cos_elevation{};
    Row sin_elevation{};
    Row range_offset{};
    Row height_offset{};
    Row side_offset{};
    Row cos_correction{};
    Row sin_correction{};
    Row fraction{};
    /// Azimuth correction and interpolation together.
    Row cos_shift{};
    Row sin_shift{};
    std::array<std::int32_t, kEntriesPerBlock> min_raw{};
    std::array<std::int32_t, kEntriesPerBlock> max_raw{};
    std::array<std::uint16_t, kEntriesPerBlock> ring{};
  };
  struct SinCos {
    float sin = 0.0F;
    float cos = 1.0F;
  };

  void fill_entry(const VelodyneSensor& sensor, const PacketEntry& entry, double min_range_m,
                  double max_range_m, Lane& lane, std::size_t c) const;
  void fill_times(const VelodyneSensor& sensor);

  float resolution_;
  bool interpolated_ = false;
  float rate_ = 0.0F;
  std::vector<Lane> lanes_;
  std::vector<SinCos> azimuths_;
  std::array<std::array<std::int32_t, kEntriesPerBlock>, kBlocksPerPacket> times_{};
  std::array<std::int32_t, kBlocksPerPacket> first_firing_ns_{};
  std::array<std::int32_t, kBlocksPerPacket> last_firing_ns_{};
};

}  // namespace nilio::drivers
