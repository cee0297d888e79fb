#pragma once

#include "nilio/core/scan.hpp"
#include "nilio/core/time.hpp"

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>

namespace nilio::core {

/// Noise, clipping and stuck values of one sensor's three axes, from the samples alone.
class TriadSignal {
 public:
  /// Values at or below `least_full_scale` never count as clipped.
  explicit TriadSignal(double least_full_scale) : least_full_scale_(least_full_scale) {}

  void add(Time stamp, const std::array<double, 3>& values);
  /// Noise in the sensor's unit, root mean square over the axes, from the differences of neighbours.
  [[nodiscard]] double noise() const;
  /// Time since any axis changed.
  [[nodiscard]] Duration unchanged() const { return last_ - changed_; }
  /// Full scale at which the sensor clipped; 0 = never.
  [[nodiscard]] double full_scale() const;
  /// Whether a sample was clipped at or after `time`.
  [[nodiscard]] bool clipped_since(Time time) const { return has_clipped_ && last_clipped_ >= time; }

 private:
  struct Axis {
    double extreme = 0.0;                                    ///< largest absolute value so far
    double least = std::numeric_limits<double>::infinity();  ///< smallest absolute value so far
    double full_scale = 0.0;  ///< extreme repeated too often in a row to be chance
    std::uint32_t run = 0;    ///< samples in a row at the extreme
  };
  bool update_clipping(Axis& axis, double value) const;

  double least_full_scale_;
  std::array<Axis, 3> axes_{};
  std::array<double, 3> previous_{};
  Time last_;
  Time changed_;
  Time last_clipped_;
  bool has_clipped_ = false;
  double square_ = 0.0;
  double weight_ = 0.0;
  std::uint64_t count_ = 0;
};

/// Lost samples and gaps, from the stamps alone.
class SampleTiming {
 public:
  explicit SampleTiming(Duration max_gap) : max_gap_(max_gap) {}

  void add(Time stamp);
  /// Share of missing samples outside gaps, 0 to 1; negative while unknown.
  [[nodiscard]] double loss() const;
  /// Longest time without a sample in the ten seconds before `now`, the present one included.
  [[nodiscard]] Duration longest_gap(Time now) const;

 private:
  static constexpr std::size_t kIntervals = 64;
  void update_usual_interval();

  Duration max_gap_;
  std::array<std::int64_t, kIntervals> intervals_{};
  std::uint64_t count_ = 0;
  std::int64_t usual_ns_ = 0;
  double received_ = 0.0;
  double expected_ = 0.0;
  Time last_;
  Duration gap_;
  Time gap_end_;
};

}  // namespace nilio::core
