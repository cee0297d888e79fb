#include "tools/inspect/clock.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace nilio::tools::inspect {

namespace {

constexpr std::int64_t kHourNs = 3'600'000'000'000;
constexpr std::int64_t kWindowNs = 1'000'000'000;
constexpr std::int64_t kClockSetNs = 500'000'000;
constexpr double kSynchronisedS = 0.2;
constexpr double kWindowsForDrift = 10.0;

/// In (-30 min, 30 min].
std::int64_t modulo_hour(std::int64_t ns) {
  ns %= kHourNs;
  if (ns > kHourNs / 2) ns -= kHourNs;
  if (ns <= -kHourNs / 2) ns += kHourNs;
  return ns;
}

}  // namespace

void ClockComparison::add(std::uint32_t timestamp_us, core::Time stamp, std::int64_t duration_ns) {
  const std::int64_t sensor_ns = static_cast<std::int64_t>(timestamp_us) * 1000 + duration_ns;
  const std::int64_t difference_ns = modulo_hour(stamp.ns % kHourNs - sensor_ns);
  const std::int64_t change_ns = open_ ? modulo_hour(difference_ns - first_ns_) : 0;
  if (!open_ || std::abs(change_ns - minimum_ns_) > kClockSetNs ||
      stamp.ns < window_start_ns_ - kClockSetNs) {
    // The offset remains that of the start.
    const bool restarted = open_;
    const std::int64_t first_minimum_ns = open_ ? first_minimum_ns_ : difference_ns;
    *this = ClockComparison();
    open_ = true;
    restarted_ = restarted;
    first_ns_ = difference_ns;
    first_minimum_ns_ = first_minimum_ns;
    start_ns_ = window_start_ns_ = minimum_at_ns_ = stamp.ns;
    return;
  }
  if (stamp.ns - window_start_ns_ >= kWindowNs) {
    close_window();
    window_start_ns_ = minimum_at_ns_ = stamp.ns;
    minimum_ns_ = change_ns;
  }
  if (change_ns < minimum_ns_) {
    minimum_ns_ = change_ns;
    minimum_at_ns_ = stamp.ns;
    if (windows_ == 0.0 && !restarted_)
      first_minimum_ns_ = std::min(first_minimum_ns_, modulo_hour(first_ns_ + change_ns));
  }
}

void ClockComparison::close_window() {
  const double t = static_cast<double>(minimum_at_ns_ - start_ns_) * 1e-9;
  const double d = static_cast<double>(minimum_ns_) * 1e-9;
  windows_ += 1.0;
  sum_t_ += t;
  sum_d_ += d;
  sum_tt_ += t * t;
  sum_td_ += t * d;
}

std::optional<ClockFindings> ClockComparison::findings() const {
  if (!open_) return std::nullopt;
  ClockFindings result;
  result.offset_s = static_cast<double>(-first_minimum_ns_) * 1e-9;
  result.agrees = std::abs(result.offset_s) < kSynchronisedS;
  const double spread = windows_ * sum_tt_ - sum_t_ * sum_t_;
  if (windows_ >= kWindowsForDrift && spread > 0.0) {
    result.drift_ppm = -1e6 * (windows_ * sum_td_ - sum_t_ * sum_d_) / spread;
  }
  return result;
}

}  // namespace nilio::tools::inspect
