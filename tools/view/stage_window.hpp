#pragma once

#include "ipc/messages/messages.hpp"
#include "tools/common/statistics.hpp"

#include <array>
#include <cstdint>
#include <deque>
#include <string_view>

namespace nilio::tools::view {

/// Durations of the stages of the scans of the last minute, from their reports. One thread.
class StageWindow {
 public:
  static constexpr std::int64_t kNs = 60'000'000'000;
  static constexpr std::size_t kStages = 11;
  /// Names of the stages as in the latency report.
  static constexpr std::array<std::string_view, kStages> kNames{"receive_to_pop",
                                                                "assemble",
                                                                "queue",
                                                                "filter",
                                                                "coarse",
                                                                "fine",
                                                                "deliver",
                                                                "pick_up",
                                                                "write",
                                                                "end_to_end",
                                                                "received_to_written"};
  /// One scan's durations in milliseconds; negative: unknown.
  using Durations = std::array<double, kStages>;

  static Durations durations_of(const dds::ScanReport& report);
  static constexpr std::size_t index_of(std::string_view name) {
    std::size_t i = 0;
    while (i < kStages && kNames[i] != name) ++i;
    return i;
  }

  void add(std::int64_t now_ns, const Durations& durations, double real_time_ratio);
  void drop_old(std::int64_t now_ns);
  /// Milliseconds, over the scans of the last `span_ns`; all zero without a value.
  [[nodiscard]] Percentiles percentiles(std::size_t stage, std::int64_t now_ns, std::int64_t span_ns) const;
  [[nodiscard]] double mean_real_time_ratio() const;

 private:
  struct Scan {
    std::int64_t ns = 0;
    Durations durations{};
    double real_time_ratio = 0.0;
  };
  std::deque<Scan> scans_;
};

}  // namespace nilio::tools::view
