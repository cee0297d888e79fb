#pragma once

#include "nilio/core/scan.hpp"
#include "nilio/drivers/velodyne/decoder.hpp"
#include "nilio/drivers/velodyne/model.hpp"

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace nilio::drivers {

struct SinCos {
  float sin = 0.0F;
  float cos = 1.0F;
};

/// Sine and cosine of every azimuth a packet can hold, 0 to 36000.
class AzimuthTable {
 public:
  AzimuthTable();
  [[nodiscard]] SinCos operator[](std::uint16_t azimuth) const { return values_[azimuth]; }
  /// Loads a value into the cache: successive azimuths are in different lines.
  void prefetch(std::uint16_t azimuth) const { __builtin_prefetch(&values_[azimuth]); }

 private:
  std::vector<SinCos> values_;
};

/// Decodes the blocks of one packet layout into points. Values that depend on the laser only are precomputed,
/// so that a point costs a few nanoseconds.
class FiringDecoder {
 public:
  /// `azimuths` must outlive the decoder.
  FiringDecoder(const VelodyneSensor& sensor, const PacketLayout& layout, const AzimuthTable& azimuths,
                double min_range_m, double max_range_m, ReturnChoice returns);

  /// Sets the azimuth advance per step (0.01 degree) for the next packets.
  void set_rate(float rate);

  struct Counts {
    std::size_t points = 0;
    std::size_t out_of_range = 0;
  };
  /// Decodes azimuth step `step` of a packet (kDataPacketSize bytes) into `points`, which must have room for
  /// kEntriesPerBlock more points than the step has entries. `time_ns` is the time of the step's azimuth
  /// relative to the scan's start. The step's azimuth must not exceed kAzimuthModulus.
  Counts decode_step(std::span<const std::uint8_t> payload, std::size_t step, std::int32_t time_ns,
                     std::span<core::Point> points) const;

  /// First and last firing of an azimuth step, relative to its azimuth's time.
  [[nodiscard]] std::int32_t first_firing_ns() const { return first_firing_ns_; }
  [[nodiscard]] std::int32_t last_firing_ns() const { return last_firing_ns_; }

 private:
  using Row = std::array<float, kEntriesPerBlock>;
  using Words = std::array<std::uint32_t, kEntriesPerBlock>;
  using Mask = std::array<std::int32_t, kEntriesPerBlock>;
  /// Precomputed values of the entries of one block of an azimuth step.
  struct BlockTable {
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
    /// Two-point distance correction: slope per metre of |x| or |y|, and value at zero.
    Row near_slope_x{};
    Row near_slope_y{};
    Row near_x{};
    Row near_y{};
    Row focal_slope{};
    Row focal_offset{};
    Row min_intensity{};
    Row max_intensity{};
    Mask far_raw{};
    Mask min_raw{};
    Mask max_raw{};
    std::array<std::int32_t, kEntriesPerBlock> time_ns{};
    Mask ring{};
    /// Block of the step with the other return of the same lasers; this block itself without one.
    std::size_t partner = 0;
    BlockContent content = BlockContent::kSingle;
  };
  struct Points {
    Row x;
    Row y;
    Row z;
    Row intensity;
  };

  void fill_table(const VelodyneSensor& sensor, const PacketLayout& layout, double min_range_m,
                  double max_range_m, std::size_t block);
  void fill_times();
  void choose_returns(const BlockTable& table, const Words& words, const Words& others, Mask& keep) const;
  void place(const BlockTable& table, SinCos azimuth, const Words& words, Points& points) const;
  void correct_near_range(const BlockTable& table, SinCos azimuth, const Words& words, Points& points) const;
  void correct_intensity(const BlockTable& table, const Words& words, Points& points) const;
  static core::Point* append(const BlockTable& table, const Points& decoded, const Mask& keep,
                             std::int32_t time_ns, core::Point* out);

  float resolution_;
  ReturnChoice returns_;
  bool interpolated_ = false;
  /// At least one laser has near-range or intensity corrections.
  bool near_corrected_ = false;
  float rate_ = 0.0F;
  std::size_t blocks_per_step_;
  std::vector<BlockTable> tables_;
  const AzimuthTable* azimuths_;
  std::int32_t first_firing_ns_ = 0;
  std::int32_t last_firing_ns_ = 0;
};

}  // namespace nilio::drivers
