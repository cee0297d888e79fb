#include "ipc/histogram.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

namespace nilio::ipc {
namespace {

constexpr double kTicksPerHalving = 5.0;
constexpr double kMsPerNs = 1e-6;

/// Next percentile (as a share) with a line: the step halves when the distance to 1 has halved.
double next_share(double share) {
  const double halvings = std::floor(std::log2(1.0 / (1.0 - share))) + 1.0;
  return share + 1.0 / (kTicksPerHalving * std::exp2(halvings));
}

template <class... Values>
void append(std::string& text, const char* format, Values... values) {
  std::array<char, 160> line{};
  std::snprintf(line.data(), line.size(), format, values...);
  text += line.data();
}

}  // namespace

std::string percentile_distribution(const HistogramSnapshot& snapshot) {
  std::string text;
  append(text, "%12s %14s %10s %14s\n\n", "Value", "Percentile", "TotalCount", "1/(1-Percentile)");
  const auto count = static_cast<double>(snapshot.count());
  const auto max_ms = static_cast<double>(snapshot.max()) * kMsPerNs;
  std::uint64_t seen = 0;
  double share = 0.0;
  for (const HistogramBucket& bucket : snapshot.buckets()) {
    seen += bucket.count;
    // Largest value equivalent within the bucket, as HdrHistogram reports it.
    const double value_ms = std::min(static_cast<double>(bucket.to_ns - 1) * kMsPerNs, max_ms);
    while (seen < snapshot.count() && share <= static_cast<double>(seen) / count) {
      append(text, "%12.6f %2.12f %10llu %14.2f\n", value_ms, share, static_cast<unsigned long long>(seen),
             1.0 / (1.0 - share));
      share = next_share(share);
    }
  }
  append(text, "%12.6f %2.12f %10llu\n", max_ms, 1.0, static_cast<unsigned long long>(snapshot.count()));
  append(text, "#[Mean    = %12.6f, StdDeviation   = %12.6f]\n", snapshot.mean() * kMsPerNs,
         snapshot.deviation() * kMsPerNs);
  append(text, "#[Max     = %12.6f, Total count    = %12llu]\n", max_ms,
         static_cast<unsigned long long>(snapshot.count()));
  append(text, "#[Buckets = %12zu, SubBuckets     = %12zu]\n",
         Histogram::kRangeBits - Histogram::kSubBucketBits, 2 * Histogram::kSubBuckets);
  return text;
}

}  // namespace nilio::ipc
