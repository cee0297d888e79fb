#include "tools/view/stage_window.hpp"

#include <string>
#include <utility>
#include <vector>

namespace nilio::tools::view {

namespace {

/// More scans than a minute has at any sensor's rate: reports come from the network.
constexpr std::size_t kMaxScans = 4096;

std::int64_t stamp_of(const dds::ScanReport& report, std::string_view name) {
  for (const dds::StageStamp& stage : report.stages) {
    if (stage.name == name) return stage.monotonic_ns;
  }
  return 0;
}

}  // namespace

StageWindow::Durations StageWindow::durations_of(const dds::ScanReport& report) {
  constexpr std::array<std::pair<const char*, const char*>, kStages> kEnds{{{"received", "popped"},
                                                                            {"popped", "completed"},
                                                                            {"completed", "started"},
                                                                            {"started", "filtered"},
                                                                            {"filtered", "coarse"},
                                                                            {"coarse", "fine"},
                                                                            {"fine", "delivered"},
                                                                            {"delivered", "taken"},
                                                                            {"taken", "written"},
                                                                            {"received", "delivered"},
                                                                            {"received", "written"}}};
  Durations durations{};
  for (std::size_t i = 0; i < kStages; ++i) {
    const std::int64_t begin = stamp_of(report, kEnds[i].first);
    const std::int64_t end = stamp_of(report, kEnds[i].second);
    durations[i] = begin > 0 && end >= begin ? static_cast<double>(end - begin) * 1e-6 : -1.0;
  }
  return durations;
}

void StageWindow::add(std::int64_t now_ns, const Durations& durations, double real_time_ratio) {
  if (scans_.size() >= kMaxScans) scans_.pop_front();
  scans_.push_back({now_ns, durations, real_time_ratio});
  drop_old(now_ns);
}

void StageWindow::drop_old(std::int64_t now_ns) {
  while (!scans_.empty() && now_ns - scans_.front().ns > kNs) scans_.pop_front();
}

Percentiles StageWindow::percentiles(std::size_t stage, std::int64_t now_ns, std::int64_t span_ns) const {
  std::vector<double> values;
  for (const Scan& scan : scans_) {
    if (now_ns - scan.ns <= span_ns && scan.durations[stage] >= 0.0) values.push_back(scan.durations[stage]);
  }
  return percentiles_of(std::move(values));
}

double StageWindow::mean_real_time_ratio() const {
  Spread ratios;
  for (const Scan& scan : scans_) ratios.add(scan.real_time_ratio);
  return ratios.mean();
}

}  // namespace nilio::tools::view
