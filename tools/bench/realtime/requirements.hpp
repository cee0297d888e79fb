#pragma once

#include "tools/bench/realtime/identity_checks.hpp"
#include "tools/bench/realtime/tables.hpp"
#include "tools/bench/report/results_page.hpp"

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace nilio::tools::bench {

/// A requirement on a live run and its result.
struct Requirement {
  enum class Verdict : std::uint8_t {
    kMet,
    kFailed,  ///< does not depend on the computer's speed or load
    kMissed,  ///< depends on the clock: another load on the computer may be the reason
    kNotMeasured,
  };
  std::string name;
  std::string run;  ///< "5 ms, cpu"
  std::string measured;
  std::string bound;
  Verdict verdict = Verdict::kNotMeasured;
};

/// Measurements of one drive.
struct RealtimeFigures {
  std::span<const RealtimeCell> cells;
  std::span<const CountedRun> counted;
  std::span<const IdentityCheck> checks;
  /// Control run whose odometry thread makes one allocation, release and lock; null when not measured.
  const ThreadWatch* planted = nullptr;
  AccuracyReference reference{};
};

/// Checks deadline, one pose per scan, accuracy by the clock, the independent reader, stopping, packets,
/// poses at IMU rate, forbidden calls, end-to-end latency and the identity checks.
std::vector<Requirement> check_requirements(const RealtimeFigures& figures);
Table requirement_table(std::span<const Requirement> requirements);
/// True when a verdict is kFailed; kMissed does not count.
bool any_failed(std::span<const Requirement> requirements);

}  // namespace nilio::tools::bench
