#pragma once

#include "nilio/core/time.hpp"

#include "ipc/records.hpp"

#include <array>
#include <atomic>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include <nlohmann/json_fwd.hpp>

namespace nilio::ipc {

/// Bucket of values from `from_ns` (inclusive) to `to_ns` (exclusive); values beyond the range are in the
/// last bucket.
struct HistogramBucket {
  std::int64_t from_ns = 0;
  std::int64_t to_ns = 0;
  std::uint64_t count = 0;
};

/// Content of a Histogram at one moment, in nanoseconds. All results are 0 while empty.
class HistogramSnapshot {
 public:
  [[nodiscard]] std::uint64_t count() const { return count_; }
  [[nodiscard]] std::int64_t min() const { return min_; }
  [[nodiscard]] std::int64_t max() const { return max_; }
  [[nodiscard]] double mean() const { return mean_; }
  /// Smallest recorded value that `percent` (0..100) of all values do not exceed, within 0.4 %.
  [[nodiscard]] std::int64_t percentile(double percent) const;
  /// Standard deviation.
  [[nodiscard]] double deviation() const;
  /// Non-empty buckets in order.
  [[nodiscard]] std::vector<HistogramBucket> buckets() const { return grouped(1); }
  /// Non-empty buckets, eight per octave, for plots.
  [[nodiscard]] std::vector<HistogramBucket> coarse_buckets() const;

 private:
  friend class Histogram;
  [[nodiscard]] std::vector<HistogramBucket> grouped(std::size_t group) const;
  std::vector<std::uint64_t> counts_;
  std::uint64_t count_ = 0;
  std::int64_t min_ = 0;
  std::int64_t max_ = 0;
  double mean_ = 0.0;
};

/// Log-linear histogram of latencies (the method of HdrHistogram): exact below 256 ns, then 128 buckets per
/// octave up to 2^36 ns = 68 s; 30 KB, no allocation. One thread records (relaxed atomics, a few ns), any
/// thread takes snapshots.
class Histogram {
 public:
  /// Records a value. Negative values count as 0; values above the range go to the last bucket, max() stays
  /// exact.
  void record(std::int64_t ns) noexcept;
  /// Records with correction for coordinated omission. A value longer than `expected_interval_ns` also
  /// represents the events that could not happen meanwhile, recorded as value - interval, value - 2
  /// intervals, ..., at most 10,000. Interval <= 0: as record().
  void record_corrected(std::int64_t ns, std::int64_t expected_interval_ns) noexcept;
  [[nodiscard]] HistogramSnapshot snapshot() const;

  static constexpr std::size_t kSubBucketBits = 7;
  static constexpr std::size_t kRangeBits = 36;
  static constexpr std::size_t kSubBuckets = std::size_t{1} << kSubBucketBits;
  static constexpr std::size_t kBuckets = kSubBuckets * (kRangeBits - kSubBucketBits + 1);
  /// Fine buckets per coarse bucket.
  static constexpr std::size_t kCoarseGroup = kSubBuckets / 8;

 private:
  friend class HistogramSnapshot;
  static std::size_t bucket_of(std::int64_t ns) noexcept;
  static std::int64_t begin_of(std::size_t bucket) noexcept;
  static std::int64_t middle_of(std::size_t bucket) noexcept;

  std::array<std::atomic<std::uint64_t>, kBuckets> counts_{};
  std::atomic<std::int64_t> sum_{0};
  std::atomic<std::int64_t> min_{0};
  std::atomic<std::int64_t> max_{0};
  std::atomic<std::uint64_t> count_{0};
};

/// Durations between the stages of a PoseRecord, and the end-to-end duration.
enum class LatencyStage : std::uint8_t {
  kReceiveToPop,
  kAssemble,
  kQueue,
  kFilter,
  kCoarse,
  kFine,
  kDeliver,
  kMap,
  kEndToEnd,  ///< received to delivered
  kCount
};
inline constexpr std::size_t kLatencyStageCount = static_cast<std::size_t>(LatencyStage::kCount);
inline constexpr std::array<std::string_view, kLatencyStageCount> kLatencyStageNames{
    "receive_to_pop", "assemble", "queue", "filter", "coarse", "fine", "deliver", "map", "end_to_end"};

/// Row of a latency report, in microseconds.
struct LatencySummary {
  std::string name;
  std::uint64_t count = 0;
  double p50_us = 0.0;
  double p90_us = 0.0;
  double p99_us = 0.0;
  double p99_9_us = 0.0;
  double max_us = 0.0;
  double mean_us = 0.0;
};
LatencySummary summarize(std::string_view name, const HistogramSnapshot& snapshot);
LatencySummary summarize(std::string_view name, const Histogram& histogram);

/// Percentile distribution in the format of HdrHistogram's plotters (.hgrm): five lines per halving of the
/// distance to 100 %, values in milliseconds.
std::string percentile_distribution(const HistogramSnapshot& snapshot);

/// Latency histograms of the scans since the start, one per stage. One thread records, any thread reads.
class LatencyHistograms {
 public:
  /// Records the stages whose stamps are known (not 0). The end-to-end latency is corrected for coordinated
  /// omission with the scan duration as the expected interval.
  void record(const PoseRecord& record) noexcept;
  [[nodiscard]] const Histogram& histogram(LatencyStage stage) const {
    return histograms_[static_cast<std::size_t>(stage)];
  }
  /// Summaries in the order of LatencyStage.
  [[nodiscard]] std::vector<LatencySummary> summaries() const;

 private:
  std::array<Histogram, kLatencyStageCount> histograms_;
};

/// {"<stage>": {"count", "p50_us", "p90_us", "p99_us", "p99_9_us", "max_us", "mean_us"}, ...}
nlohmann::json latency_json(const std::vector<LatencySummary>& summaries);
nlohmann::json latency_json(const LatencyHistograms& histograms);
/// Same content as text lines with a heading.
std::string latency_table(const std::vector<LatencySummary>& summaries);
std::string latency_table(const LatencyHistograms& histograms);

}  // namespace nilio::ipc
