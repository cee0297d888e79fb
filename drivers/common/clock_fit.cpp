#include "drivers/common/clock_fit.hpp"

#include <algorithm>

namespace nilio::drivers {
namespace {

constexpr std::int64_t kWindowNs = 1'000'000'000;
/// Upper limit of the drift between oscillators (the HDL-64E's is at most 58 parts per million).
constexpr double kLargestDrift = 100e-6;
/// With fewer windows jitter would look like drift.
constexpr std::size_t kWindowsForDrift = 8;

}  // namespace

void ClockFit::observe(std::int64_t sensor_ns, std::int64_t difference_ns) {
  if (window_open_ && sensor_ns - window_start_ns_ >= kWindowNs) close_window();
  if (!window_open_) {
    window_open_ = true;
    window_start_ns_ = sensor_ns;
    least_ = {sensor_ns, difference_ns};
  } else if (difference_ns < least_.difference_ns) {
    least_ = {sensor_ns, difference_ns};
  }
  if (count_ == 0) anchor_ = least_;
}

void ClockFit::close_window() {
  samples_[next_] = least_;
  next_ = (next_ + 1) % kWindows;
  count_ = std::min(count_ + 1, kWindows);
  window_open_ = false;
  fit();
}

/// Of all lines below the points, the lower hull's edge at the mean time has the smallest mean distance.
void ClockFit::fit() {
  std::array<Sample, kWindows> hull;
  std::size_t size = 0;
  double mean = 0.0;
  const std::size_t oldest = (next_ + kWindows - count_) % kWindows;
  const Sample origin = samples_[oldest];
  const auto x = [&](const Sample& s) { return static_cast<double>(s.sensor_ns - origin.sensor_ns); };
  const auto y = [&](const Sample& s) { return static_cast<double>(s.difference_ns - origin.difference_ns); };
  for (std::size_t i = 0; i < count_; ++i) {
    const Sample& s = samples_[(oldest + i) % kWindows];
    mean += x(s) / static_cast<double>(count_);
    while (size >= 2) {
      const Sample& a = hull[size - 2];
      const Sample& b = hull[size - 1];
      const double turn = (x(b) - x(a)) * (y(s) - y(a)) - (y(b) - y(a)) * (x(s) - x(a));
      if (turn > 0.0) break;
      --size;
    }
    hull[size++] = s;
  }
  drift_ = 0.0;
  for (std::size_t i = 1; i < size && count_ >= kWindowsForDrift; ++i) {
    if (x(hull[i]) < mean && i + 1 < size) continue;
    drift_ = (y(hull[i]) - y(hull[i - 1])) / (x(hull[i]) - x(hull[i - 1]));
    break;
  }
  drift_ = std::clamp(drift_, -kLargestDrift, kLargestDrift);
  // Shift the line so that it touches the points from below.
  const auto height = [&](const Sample& s) { return y(s) - drift_ * x(s); };
  anchor_ = *std::min_element(hull.begin(), hull.begin() + static_cast<std::ptrdiff_t>(size),
                              [&](const Sample& a, const Sample& b) { return height(a) < height(b); });
}

std::int64_t ClockFit::offset_at(std::int64_t sensor_ns) const {
  return anchor_.difference_ns +
         static_cast<std::int64_t>(drift_ * static_cast<double>(sensor_ns - anchor_.sensor_ns));
}

}  // namespace nilio::drivers
