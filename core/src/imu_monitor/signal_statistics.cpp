#include "core/src/imu_monitor/signal_statistics.hpp"

#include <algorithm>
#include <cmath>

namespace nilio::core {

namespace {

// Equal values in a row at the extreme: with noise of one digit the probability is below 1e-7.
constexpr std::uint32_t kClippedRun = 20;
// Samples over which noise and losses are averaged.
constexpr double kSampleMemory = 0.999;
constexpr double kMinSamples = 100.0;
// Below this share of regular intervals stamps come in bursts and the loss is unknown.
constexpr double kMinRegularity = 0.3;
constexpr Duration kGapMemory = Duration::from_seconds(10.0);

}  // namespace

bool TriadSignal::update_clipping(Axis& axis, double value) const {
  const double size = std::abs(value);
  axis.least = std::min(axis.least, size);
  if (size > axis.extreme) {
    axis = {size, axis.least, 0.0, 1};
    return false;
  }
  axis.run = size == axis.extreme ? axis.run + 1 : 0;
  // An axis that has never moved is stuck rather than clipped.
  const bool has_moved = axis.least < 0.5 * axis.extreme;
  if (axis.run >= kClippedRun && size > least_full_scale_ && has_moved) axis.full_scale = size;
  return axis.full_scale > 0.0 && size == axis.full_scale;
}

void TriadSignal::add(Time stamp, const std::array<double, 3>& values) {
  bool changed = count_ == 0;
  double square = 0.0;
  for (std::size_t i = 0; i < 3; ++i) {
    if (update_clipping(axes_[i], values[i])) {
      last_clipped_ = stamp;
      has_clipped_ = true;
    }
    const double difference = values[i] - previous_[i];
    changed = changed || difference != 0.0;
    square += difference * difference;
  }
  if (changed) changed_ = stamp;
  if (count_ > 0) {
    // A difference contains the noise of two samples; the mean is over three axes.
    square_ = kSampleMemory * square_ + square / 6.0;
    weight_ = kSampleMemory * weight_ + 1.0;
  }
  previous_ = values;
  last_ = stamp;
  ++count_;
}

double TriadSignal::noise() const { return weight_ > 0.0 ? std::sqrt(square_ / weight_) : 0.0; }

double TriadSignal::full_scale() const {
  double least = 0.0;
  for (const Axis& axis : axes_) {
    if (axis.full_scale > 0.0 && (least == 0.0 || axis.full_scale < least)) least = axis.full_scale;
  }
  return least;
}

void SampleTiming::update_usual_interval() {
  // The lower quartile is still one interval when half of the samples are lost.
  std::array<std::int64_t, kIntervals> sorted = intervals_;
  const auto quartile = sorted.begin() + kIntervals / 4;
  std::nth_element(sorted.begin(), quartile, sorted.end());
  usual_ns_ = *quartile;
}

void SampleTiming::add(Time stamp) {
  const Duration interval = stamp - last_;
  last_ = stamp;
  if (count_++ == 0) return;
  if (interval >= longest_gap(stamp)) {
    gap_ = interval;
    gap_end_ = stamp;
  }
  if (interval > max_gap_) return;
  intervals_[count_ % kIntervals] = interval.ns;
  if (count_ % kIntervals == 0) update_usual_interval();
  if (usual_ns_ <= 0) return;
  received_ = kSampleMemory * received_ + 1.0;
  const double intervals = static_cast<double>(interval.ns) / static_cast<double>(usual_ns_);
  expected_ = kSampleMemory * expected_ + std::max(1.0, std::round(intervals));
}

double SampleTiming::loss() const {
  if (received_ < kMinSamples || received_ < kMinRegularity * expected_) return -1.0;
  return 1.0 - received_ / expected_;
}

Duration SampleTiming::longest_gap(Time now) const {
  const Duration present = count_ > 0 ? now - last_ : Duration{0};
  return now - gap_end_ < kGapMemory ? std::max(gap_, present) : present;
}

}  // namespace nilio::core
