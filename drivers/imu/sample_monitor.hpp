#pragma once

#include "nilio/core/scan.hpp"
#include "nilio/drivers/imu/decoder.hpp"

#include <array>
#include <cstddef>
#include <cstdint>

namespace nilio::drivers {

/// Median of the latest 15 intervals.
class MedianInterval {
 public:
  void observe(std::int64_t interval_ns);
  /// 0 before the fifth interval.
  [[nodiscard]] std::int64_t ns() const { return count_ < kEnough ? 0 : median_ns_; }

 private:
  static constexpr std::size_t kEnough = 5;
  std::array<std::int64_t, 15> intervals_{};  ///< ring
  std::size_t count_ = 0;
  std::size_t next_ = 0;
  std::int64_t median_ns_ = 0;
};

/// Counts gaps between good samples, and values that do not change.
class ImuSampleMonitor {
 public:
  void observe(const core::ImuSample& sample, ImuDecoderStats& stats);

 private:
  void observe_interval(std::int64_t interval_ns, ImuDecoderStats& stats);

  MedianInterval median_interval_;
  core::ImuSample last_;
  bool has_last_ = false;
  std::uint64_t same_in_a_row_ = 0;
};

}  // namespace nilio::drivers
