#include "ipc/histogram.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <memory>
#include <random>
#include <thread>
#include <vector>

#include <catch2/catch.hpp>
#include <nlohmann/json.hpp>

namespace {

using nilio::ipc::Histogram;
using nilio::ipc::LatencyHistograms;
using nilio::ipc::LatencyStage;
using nilio::ipc::PoseRecord;

std::int64_t exact_percentile(const std::vector<std::int64_t>& sorted, double percent) {
  const auto rank = static_cast<std::size_t>(std::ceil(percent / 100.0 * static_cast<double>(sorted.size())));
  return sorted[std::max<std::size_t>(rank, 1) - 1];
}

PoseRecord record_with_stages(std::int64_t start_ns, std::int64_t step_ns) {
  PoseRecord record;
  record.scan_start_ns = 0;
  record.stamp_ns = 100'000'000;
  for (std::size_t i = 0; i < nilio::ipc::kStageCount; ++i)
    record.stage_ns[i] = start_ns + step_ns * static_cast<std::int64_t>(i);
  return record;
}

}  // namespace

TEST_CASE("an empty histogram returns zeros", "[histogram]") {
  const auto snapshot = std::make_unique<Histogram>()->snapshot();
  CHECK(snapshot.count() == 0);
  CHECK(snapshot.min() == 0);
  CHECK(snapshot.max() == 0);
  CHECK(snapshot.mean() == 0.0);
  CHECK(snapshot.percentile(99.0) == 0);
}

TEST_CASE("every percentile of a log-normal latency is within 0.4 percent of the exact one", "[histogram]") {
  auto histogram = std::make_unique<Histogram>();
  std::mt19937_64 random(7);
  std::lognormal_distribution<double> latency(11.0, 2.0);  // median 60 us, with a tail beyond 10 s
  std::vector<std::int64_t> values;
  double sum = 0.0;
  for (int i = 0; i < 200'000; ++i) {
    const auto value = std::min(static_cast<std::int64_t>(latency(random)), std::int64_t{60'000'000'000});
    values.push_back(value);
    histogram->record(value);
    sum += static_cast<double>(value);
  }
  std::sort(values.begin(), values.end());
  const auto snapshot = histogram->snapshot();
  CHECK(snapshot.count() == values.size());
  CHECK(snapshot.min() == values.front());
  CHECK(snapshot.max() == values.back());
  CHECK(snapshot.mean() == Approx(sum / static_cast<double>(values.size())));
  for (const double percent : {0.001, 1.0, 25.0, 50.0, 75.0, 90.0, 99.0, 99.9, 99.99, 100.0}) {
    INFO("percentile " << percent);
    const auto exact = static_cast<double>(exact_percentile(values, percent));
    CHECK(std::abs(static_cast<double>(snapshot.percentile(percent)) - exact) <= 0.004 * exact);
  }
}

TEST_CASE("values up to 255 ns are exact, and the relative error holds in every octave", "[histogram]") {
  for (std::int64_t value = 0; value < 256; ++value) {
    auto histogram = std::make_unique<Histogram>();
    histogram->record(value);
    histogram->record(1'000'000);  // so that the value is not also the maximum
    REQUIRE(histogram->snapshot().percentile(50.0) == value);
  }
  for (int bit = 8; bit < 36; ++bit) {
    for (const std::int64_t offset : {-1, 0, 1}) {
      auto histogram = std::make_unique<Histogram>();
      const std::int64_t value = (std::int64_t{1} << bit) + offset;
      histogram->record(value);
      histogram->record(std::int64_t{1} << 36);
      histogram->record(0);
      const auto found = static_cast<double>(histogram->snapshot().percentile(50.0));
      REQUIRE(std::abs(found - static_cast<double>(value)) <= 0.004 * static_cast<double>(value));
    }
  }
}

TEST_CASE("values out of range go to the end buckets and keep the exact maximum", "[histogram]") {
  auto histogram = std::make_unique<Histogram>();
  histogram->record(-5);
  histogram->record(std::int64_t{1} << 62);
  const auto snapshot = histogram->snapshot();
  CHECK(snapshot.count() == 2);
  CHECK(snapshot.min() == 0);
  CHECK(snapshot.max() == std::int64_t{1} << 62);
  CHECK(snapshot.percentile(50.0) == 0);
}

TEST_CASE("one stall also counts the events that could not happen during it", "[histogram]") {
  constexpr std::int64_t interval_ns = 100'000'000;  // 10 Hz
  auto plain = std::make_unique<Histogram>();
  auto corrected = std::make_unique<Histogram>();
  for (int i = 0; i < 1000; ++i) {
    const std::int64_t value = i == 500 ? 10'000'000'000 : 5'000'000;  // 10 s once, else 5 ms
    plain->record(value);
    corrected->record_corrected(value, interval_ns);
  }
  // 10.0 s, 9.9 s, ... 0.1 s: 100 late scans, not one.
  CHECK(corrected->snapshot().count() == 1000 + 99);
  CHECK(plain->snapshot().percentile(99.0) < 6'000'000);
  CHECK(static_cast<double>(corrected->snapshot().percentile(99.0)) == Approx(9.0e9).epsilon(0.01));
  CHECK(corrected->snapshot().max() == 10'000'000'000);
}

TEST_CASE("the correction is bounded for extreme intervals", "[histogram]") {
  auto histogram = std::make_unique<Histogram>();
  histogram->record_corrected(60'000'000'000, 1);
  CHECK(histogram->snapshot().count() == 10'001);
  histogram->record_corrected(60'000'000'000, 0);
  histogram->record_corrected(60'000'000'000, -1);
  CHECK(histogram->snapshot().count() == 10'003);
}

TEST_CASE("snapshots can be taken while another thread records", "[histogram]") {
  auto histogram = std::make_unique<Histogram>();
  constexpr std::uint64_t value_count = 300'000;
  std::thread writer([&] {
    for (std::uint64_t i = 0; i < value_count; ++i)
      histogram->record(1000 + static_cast<std::int64_t>(i % 1000));
  });
  std::uint64_t last = 0;
  bool monotonic = true;
  bool in_range = true;
  while (last < value_count) {
    const auto snapshot = histogram->snapshot();
    monotonic = monotonic && snapshot.count() >= last;
    last = snapshot.count();
    const std::int64_t median = snapshot.percentile(50.0);
    in_range = in_range && (last == 0 || (median >= 990 && median <= 2010));
    std::this_thread::yield();
  }
  writer.join();
  CHECK(monotonic);
  CHECK(in_range);
}

TEST_CASE("a pose record fills the histogram of every stage and of the end-to-end latency", "[histogram]") {
  auto latency = std::make_unique<LatencyHistograms>();
  latency->record(record_with_stages(1'000'000'000, 1'000'000));
  for (std::size_t i = 0; i + 1 < nilio::ipc::kLatencyStageCount; ++i) {
    INFO(nilio::ipc::kLatencyStageNames[i]);
    const auto stage = latency->histogram(static_cast<LatencyStage>(i)).snapshot();
    CHECK(stage.count() == 1);
    CHECK(stage.max() == 1'000'000);
  }
  CHECK(latency->histogram(LatencyStage::kEndToEnd).snapshot().max() == 7'000'000);
}

TEST_CASE("a stage with an unknown stamp is skipped", "[histogram]") {
  auto latency = std::make_unique<LatencyHistograms>();
  PoseRecord record = record_with_stages(1'000'000'000, 1'000'000);
  record.stage_ns[static_cast<std::size_t>(nilio::ipc::Stage::kCoarse)] = 0;
  latency->record(record);
  CHECK(latency->histogram(LatencyStage::kCoarse).snapshot().count() == 0);
  CHECK(latency->histogram(LatencyStage::kFine).snapshot().count() == 0);
  CHECK(latency->histogram(LatencyStage::kMap).snapshot().count() == 1);
  CHECK(latency->histogram(LatencyStage::kEndToEnd).snapshot().count() == 1);
}

TEST_CASE("the end-to-end latency is corrected with the scan period", "[histogram]") {
  auto latency = std::make_unique<LatencyHistograms>();
  latency->record(record_with_stages(1'000'000'000, 125'000'000));  // 0.875 s in all, scans of 100 ms
  CHECK(latency->histogram(LatencyStage::kEndToEnd).snapshot().count() == 8);
  CHECK(latency->histogram(LatencyStage::kMap).snapshot().count() == 1);
}

TEST_CASE("latency exports in microseconds as JSON and as a table", "[histogram]") {
  auto latency = std::make_unique<LatencyHistograms>();
  latency->record(record_with_stages(1'000'000'000, 2'000'000));
  const nlohmann::json json = nilio::ipc::latency_json(*latency);
  CHECK(json.size() == nilio::ipc::kLatencyStageCount);
  for (const char* key : {"count", "p50_us", "p90_us", "p99_us", "p99_9_us", "max_us", "mean_us"}) {
    INFO(key);
    REQUIRE(json.at("end_to_end").contains(key));
  }
  CHECK(json["end_to_end"]["count"] == 1);
  CHECK(json["end_to_end"]["p99_us"] == 14'000.0);
  CHECK(json["filter"]["max_us"] == 2'000.0);
  const std::string table = nilio::ipc::latency_table(*latency);
  CHECK(std::count(table.begin(), table.end(), '\n') == 1 + static_cast<int>(nilio::ipc::kLatencyStageCount));
  CHECK(table.find("14000.0") != std::string::npos);
}

TEST_CASE("fine and coarse buckets contain every value once and within their bounds", "[histogram]") {
  auto histogram = std::make_unique<Histogram>();
  std::mt19937_64 random(5);
  std::lognormal_distribution<double> latency(12.0, 2.0);
  std::vector<std::int64_t> values;
  for (int i = 0; i < 20'000; ++i) {
    values.push_back(static_cast<std::int64_t>(latency(random)));
    histogram->record(values.back());
  }
  const auto snapshot = histogram->snapshot();
  for (const auto& buckets : {snapshot.buckets(), snapshot.coarse_buckets()}) {
    std::uint64_t count = 0;
    std::int64_t last = 0;
    for (const nilio::ipc::HistogramBucket& bucket : buckets) {
      REQUIRE(bucket.from_ns >= last);
      REQUIRE(bucket.count > 0);
      const auto inside = std::count_if(values.begin(), values.end(), [&](std::int64_t value) {
        return value >= bucket.from_ns && value < bucket.to_ns;
      });
      REQUIRE(static_cast<std::uint64_t>(inside) == bucket.count);
      last = bucket.to_ns;
      count += bucket.count;
    }
    CHECK(count == values.size());
  }
  CHECK(snapshot.coarse_buckets().size() <= 8 * 29);
  double sum = 0.0;
  for (const std::int64_t value : values) sum += std::pow(static_cast<double>(value) - snapshot.mean(), 2.0);
  CHECK(snapshot.deviation() == Approx(std::sqrt(sum / static_cast<double>(values.size()))).epsilon(0.01));
}
