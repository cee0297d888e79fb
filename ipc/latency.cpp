#include "ipc/histogram.hpp"

#include <array>
#include <cstdio>

#include <nlohmann/json.hpp>

namespace nilio::ipc {

LatencySummary summarize(std::string_view name, const Histogram& histogram) {
  return summarize(name, histogram.snapshot());
}

LatencySummary summarize(std::string_view name, const HistogramSnapshot& snapshot) {
  const auto percentile_us = [&](double percent) {
    return static_cast<double>(snapshot.percentile(percent)) * 1e-3;
  };
  return {.name = std::string(name),
          .count = snapshot.count(),
          .p50_us = percentile_us(50.0),
          .p90_us = percentile_us(90.0),
          .p99_us = percentile_us(99.0),
          .p99_9_us = percentile_us(99.9),
          .max_us = static_cast<double>(snapshot.max()) * 1e-3,
          .mean_us = snapshot.mean() * 1e-3};
}

void LatencyHistograms::record(const PoseRecord& record) noexcept {
  // Latency stage i lies between the stamps i and i + 1.
  static_assert(kLatencyStageCount == kStageCount);
  for (std::size_t i = 0; i + 1 < kStageCount; ++i) {
    const std::int64_t begin = record.stage_ns[i];
    const std::int64_t end = record.stage_ns[i + 1];
    if (begin != 0 && end != 0) histograms_[i].record(end - begin);
  }
  const std::int64_t received = record.stage_time_ns(Stage::kReceived);
  const std::int64_t delivered = record.stage_time_ns(Stage::kDelivered);
  if (received == 0 || delivered == 0) return;
  histograms_[static_cast<std::size_t>(LatencyStage::kEndToEnd)].record_corrected(
      delivered - received, record.stamp_ns - record.scan_start_ns);
}

std::vector<LatencySummary> LatencyHistograms::summaries() const {
  std::vector<LatencySummary> summaries;
  summaries.reserve(kLatencyStageCount);
  for (std::size_t i = 0; i < kLatencyStageCount; ++i)
    summaries.push_back(summarize(kLatencyStageNames[i], histograms_[i]));
  return summaries;
}

nlohmann::json latency_json(const std::vector<LatencySummary>& summaries) {
  nlohmann::json stages = nlohmann::json::object();
  for (const LatencySummary& stage : summaries) {
    stages[stage.name] = {{"count", stage.count},    {"p50_us", stage.p50_us},     {"p90_us", stage.p90_us},
                          {"p99_us", stage.p99_us},  {"p99_9_us", stage.p99_9_us}, {"max_us", stage.max_us},
                          {"mean_us", stage.mean_us}};
  }
  return stages;
}

nlohmann::json latency_json(const LatencyHistograms& histograms) {
  return latency_json(histograms.summaries());
}

std::string latency_table(const std::vector<LatencySummary>& summaries) {
  std::array<char, 160> line{};
  std::snprintf(line.data(), line.size(), "%-20s %10s %11s %11s %11s %11s %11s %11s\n", "stage [us]", "count",
                "p50", "p90", "p99", "p99.9", "max", "mean");
  std::string table = line.data();
  for (const LatencySummary& stage : summaries) {
    std::snprintf(line.data(), line.size(), "%-20s %10llu %11.1f %11.1f %11.1f %11.1f %11.1f %11.1f\n",
                  stage.name.c_str(), static_cast<unsigned long long>(stage.count), stage.p50_us,
                  stage.p90_us, stage.p99_us, stage.p99_9_us, stage.max_us, stage.mean_us);
    table += line.data();
  }
  return table;
}

std::string latency_table(const LatencyHistograms& histograms) {
  return latency_table(histograms.summaries());
}

}  // namespace nilio::ipc
