#include "drivers/imu/sample_monitor.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>

namespace nilio::drivers {
namespace {

/// So many samples in a row that noise changes at least one of six values, at any resolution.
constexpr std::uint64_t kMostSame = 100;

std::array<std::uint64_t, 3> bits_of(const std::array<double, 3>& values) {
  return std::bit_cast<std::array<std::uint64_t, 3>>(values);
}

/// Compares bit by bit, because missing axes are NaN.
bool same_values(const core::ImuSample& a, const core::ImuSample& b) {
  return bits_of(a.angular_velocity) == bits_of(b.angular_velocity) &&
         bits_of(a.linear_acceleration) == bits_of(b.linear_acceleration);
}

}  // namespace

void ImuSampleMonitor::observe(const core::ImuSample& sample, ImuDecoderStats& stats) {
  if (has_last_) {
    same_in_a_row_ = same_values(sample, last_) ? same_in_a_row_ + 1 : 0;
    if (same_in_a_row_ >= kMostSame) ++stats.frozen;
    observe_interval((sample.stamp - last_.stamp).ns, stats);
  }
  last_ = sample;
  has_last_ = true;
}

void ImuSampleMonitor::observe_interval(std::int64_t interval_ns, ImuDecoderStats& stats) {
  stats.longest_gap = std::max(stats.longest_gap, core::Duration{interval_ns});
  const std::int64_t median_ns = median_interval_.ns();
  if (median_ns > 0 && interval_ns > median_ns + median_ns / 2) ++stats.gaps;
  median_interval_.observe(interval_ns);
}

void MedianInterval::observe(std::int64_t interval_ns) {
  intervals_[next_] = interval_ns;
  next_ = (next_ + 1) % intervals_.size();
  count_ = std::min(count_ + 1, intervals_.size());
  auto sorted = intervals_;
  const auto end = sorted.begin() + static_cast<std::ptrdiff_t>(count_);
  const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(count_ / 2);
  std::nth_element(sorted.begin(), middle, end);
  median_ns_ = *middle;
}

}  // namespace nilio::drivers
