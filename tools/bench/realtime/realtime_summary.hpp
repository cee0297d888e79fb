#pragma once

#include "tools/bench/odometry/table.hpp"
#include "tools/bench/realtime/identity_checks.hpp"
#include "tools/bench/realtime/realtime_table.hpp"

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace nilio::tools {

/// Something that is asked of a run in real time, and what came of it.
struct Demand {
  enum class Verdict : std::uint8_t {
    kMet,
    kFailed,  ///< whatever the computer and its load are
    kMissed,  ///< by the clock, which another load on the computer may be the reason of
    kNotMeasured,
  };
  std::string asked;
  std::string run;  ///< "5 ms, hogs"
  std::string measured;
  std::string bound;
  Verdict verdict = Verdict::kNotMeasured;
};

/// What was measured of a drive.
struct RealtimeFigures {
  std::span<const RealtimeCell> cells;
  std::span<const CountedRun> counted;
  std::span<const IdentityCheck> checks;
  /// A run whose odometry thread was made to allocate, release and lock once each; nothing when it was not
  /// watched.
  const ThreadWatch* planted = nullptr;
};

/// The deadline, one pose a scan, packets, poses at IMU rate, allocations, end to end, identity.
std::vector<Demand> judge_realtime(const RealtimeFigures& figures);
BenchTable demand_table(std::span<const Demand> demands);
/// True when one failed; one that was only missed by the clock has not.
bool any_failed(std::span<const Demand> demands);

}  // namespace nilio::tools
