#include "ipc/histogram.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

namespace nilio::ipc {
namespace {

constexpr std::int64_t kMaxBackfills = 10'000;

// Only one thread writes, so separate load and store replace a locked read-modify-write.
template <class T>
void add(std::atomic<T>& counter, T amount) noexcept {
  counter.store(counter.load(std::memory_order_relaxed) + amount, std::memory_order_relaxed);
}

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

std::size_t Histogram::bucket_of(std::int64_t ns) noexcept {
  const auto value =
      static_cast<std::uint64_t>(std::clamp<std::int64_t>(ns, 0, (std::int64_t{1} << kRangeBits) - 1));
  if (value < 2 * kSubBuckets) return value;
  const std::size_t shift = std::bit_width(value) - 1 - kSubBucketBits;
  return shift * kSubBuckets + (value >> shift);
}

std::int64_t Histogram::begin_of(std::size_t bucket) noexcept {
  if (bucket < 2 * kSubBuckets) return static_cast<std::int64_t>(bucket);
  const std::size_t shift = bucket / kSubBuckets - 1;
  const std::uint64_t mantissa = bucket - shift * kSubBuckets;
  return static_cast<std::int64_t>(mantissa << shift);
}

std::int64_t Histogram::middle_of(std::size_t bucket) noexcept {
  return (begin_of(bucket) + begin_of(bucket + 1)) / 2;
}

void Histogram::record(std::int64_t ns) noexcept {
  const std::int64_t value = std::max<std::int64_t>(ns, 0);
  add(counts_[bucket_of(value)], std::uint64_t{1});
  // A single stamp out of range must not overflow the sum.
  add(sum_, std::min(value, std::int64_t{1} << kRangeBits));
  const std::uint64_t count = count_.load(std::memory_order_relaxed);
  if (count == 0 || value < min_.load(std::memory_order_relaxed))
    min_.store(value, std::memory_order_relaxed);
  if (value > max_.load(std::memory_order_relaxed)) max_.store(value, std::memory_order_relaxed);
  count_.store(count + 1, std::memory_order_relaxed);
}

void Histogram::record_corrected(std::int64_t ns, std::int64_t expected_interval_ns) noexcept {
  record(ns);
  if (expected_interval_ns <= 0) return;
  std::int64_t missed = ns - expected_interval_ns;
  for (std::int64_t i = 0; i < kMaxBackfills && missed >= expected_interval_ns; ++i) {
    record(missed);
    missed -= expected_interval_ns;
  }
}

HistogramSnapshot Histogram::snapshot() const {
  HistogramSnapshot snapshot;
  snapshot.counts_.reserve(kBuckets);
  for (const auto& count : counts_) {
    snapshot.counts_.push_back(count.load(std::memory_order_relaxed));
    snapshot.count_ += snapshot.counts_.back();
  }
  if (snapshot.count_ == 0) return snapshot;
  snapshot.min_ = min_.load(std::memory_order_relaxed);
  snapshot.max_ = max_.load(std::memory_order_relaxed);
  const auto recorded =
      static_cast<double>(std::max<std::uint64_t>(count_.load(std::memory_order_relaxed), 1));
  snapshot.mean_ = static_cast<double>(sum_.load(std::memory_order_relaxed)) / recorded;
  return snapshot;
}

std::int64_t HistogramSnapshot::percentile(double percent) const {
  if (count_ == 0) return 0;
  const double wanted = std::clamp(percent, 0.0, 100.0) / 100.0 * static_cast<double>(count_);
  const auto rank = std::clamp<std::uint64_t>(static_cast<std::uint64_t>(std::ceil(wanted)), 1, count_);
  if (rank == count_) return max_;
  std::uint64_t seen = 0;
  for (std::size_t bucket = 0; bucket < counts_.size(); ++bucket) {
    seen += counts_[bucket];
    if (seen >= rank) return std::clamp(Histogram::middle_of(bucket), min_, std::max(min_, max_));
  }
  return max_;
}

double HistogramSnapshot::deviation() const {
  if (count_ == 0) return 0.0;
  // Deviation about the mean of the copied buckets; mean() may include newer values.
  double sum = 0.0;
  double square = 0.0;
  for (std::size_t bucket = 0; bucket < counts_.size(); ++bucket) {
    const auto value = static_cast<double>(Histogram::middle_of(bucket));
    sum += static_cast<double>(counts_[bucket]) * value;
    square += static_cast<double>(counts_[bucket]) * value * value;
  }
  const double mean = sum / static_cast<double>(count_);
  return std::sqrt(std::max(0.0, square / static_cast<double>(count_) - mean * mean));
}

std::vector<HistogramBucket> HistogramSnapshot::coarse_buckets() const {
  return grouped(Histogram::kCoarseGroup);
}

std::vector<HistogramBucket> HistogramSnapshot::grouped(std::size_t group) const {
  std::vector<HistogramBucket> result;
  for (std::size_t first = 0; first < counts_.size(); first += group) {
    std::uint64_t count = 0;
    for (std::size_t i = first; i < first + group; ++i) count += counts_[i];
    if (count > 0) result.push_back({Histogram::begin_of(first), Histogram::begin_of(first + group), count});
  }
  return result;
}

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
