#include "tools/bench/realtime/realtime_summary.hpp"

#include <algorithm>
#include <utility>

namespace nilio::tools {

namespace {

using Verdict = Demand::Verdict;

constexpr double kMillisecondUs = 1000.0;
constexpr double kMostImuPoseUs = 1000.0;
constexpr double kMostToSubscriberUs = 10'000.0;
/// What a planted run is caught at: an allocation, a release and a lock.
constexpr std::uint64_t kPlanted = 3;

std::string us(double value) { return fixed(value, 0) + " us"; }
std::string ms(double value_us) { return fixed(value_us / kMillisecondUs, 2) + " ms"; }

bool has(const std::optional<ipc::LatencySummary>& summary) { return summary && summary->count > 0; }

Demand deadline_by_count(const CountedRun& run) {
  Demand demand{"past the budget, p99: less than an iteration, counted", fixed(run.budget_ms, 0) + " ms", "-",
                "-", Verdict::kNotMeasured};
  const RunFigures& f = run.figures;
  if (!has(f.overshoot) || !has(f.iteration)) return demand;
  demand.measured = us(f.overshoot->p99_us);
  demand.bound = us(f.iteration->p50_us);
  demand.verdict = f.overshoot->p99_us < f.iteration->p50_us ? Verdict::kMet : Verdict::kFailed;
  return demand;
}

Demand deadline_by_clock(const RealtimeCell& cell) {
  Demand demand{"past the budget, p99: less than an iteration beside the noise", run_text(cell), "-", "-",
                Verdict::kNotMeasured};
  const RunFigures& f = cell.run.figures;
  if (!has(f.overshoot) || !has(f.iteration)) return demand;
  demand.measured = us(f.overshoot->p99_us);
  demand.bound = us(f.iteration->p50_us) + " + " + us(cell.run.noise.p99_us);
  demand.verdict =
      f.overshoot->p99_us < f.iteration->p50_us + cell.run.noise.p99_us ? Verdict::kMet : Verdict::kMissed;
  return demand;
}

/// Scans that a newer one supersedes have none, and are counted: of the search for a sensor's calibration, or
/// because the computer gave no processor for as long as a scan.
Demand pose_per_scan(const RealtimeCell& cell) {
  const RunFigures& f = cell.run.figures;
  Demand demand{"one pose a scan", run_text(cell), std::to_string(f.poses), std::to_string(f.scans),
                Verdict::kFailed};
  if (f.superseded > 0) demand.bound += ", " + std::to_string(f.superseded) + " superseded";
  if (f.poses > 0 && f.poses + f.superseded == f.scans)
    demand.verdict = f.superseded == 0 ? Verdict::kMet : Verdict::kMissed;
  return demand;
}

Demand packets(const RealtimeCell& cell) {
  const RunFigures& f = cell.run.figures;
  const std::uint64_t lost = f.packets_lost + f.packets_dropped;
  return {"no packet lost", run_text(cell), std::to_string(lost), "0",
          lost == 0 ? Verdict::kMet : Verdict::kMissed};
}

/// One line for all runs, when all met it.
void add_for_all(std::vector<Demand> runs, std::vector<Demand>& demands) {
  const bool all_met = std::all_of(runs.begin(), runs.end(),
                                   [](const Demand& demand) { return demand.verdict == Verdict::kMet; });
  if (all_met && runs.size() > 1) {
    Demand& first = runs.front();
    first.run = "each of " + std::to_string(runs.size());
    const bool is_same = std::all_of(runs.begin(), runs.end(), [&first](const Demand& demand) {
      return demand.measured == first.measured && demand.bound == first.bound;
    });
    if (!is_same) first.measured = first.bound = "as tabled";
    runs.resize(1);
  }
  demands.insert(demands.end(), runs.begin(), runs.end());
}

Demand imu_poses(const RealtimeCell& cell) {
  Demand demand{"pose at IMU rate, p99: within 1 ms beside the noise", run_text(cell), "-", "-",
                Verdict::kNotMeasured};
  if (!has(cell.run.imu_pose)) return demand;
  demand.measured = us(cell.run.imu_pose->p99_us);
  demand.bound = us(kMostImuPoseUs) + " + " + us(cell.run.noise.p99_us);
  demand.verdict =
      cell.run.imu_pose->p99_us <= kMostImuPoseUs + cell.run.noise.p99_us ? Verdict::kMet : Verdict::kMissed;
  return demand;
}

Demand allocations(const RealtimeCell& cell) {
  Demand demand{"allocations, locks, exceptions, output in real-time threads", run_text(cell),
                cell.run.why_not_watched, "0", Verdict::kNotMeasured};
  if (!cell.run.watch) return demand;
  const std::uint64_t count = offences(*cell.run.watch);
  demand.measured = std::to_string(count);
  demand.verdict = count == 0 ? Verdict::kMet : Verdict::kFailed;
  return demand;
}

Demand planted(const ThreadWatch* watch) {
  Demand demand{"allocation, release and lock planted in the odometry thread are counted",
                "as fast as it goes", "-", std::to_string(kPlanted), Verdict::kNotMeasured};
  if (watch == nullptr) return demand;
  demand.measured = std::to_string(offences(*watch));
  demand.verdict = offences(*watch) == kPlanted ? Verdict::kMet : Verdict::kFailed;
  return demand;
}

Demand to_subscriber(const RealtimeCell& cell) {
  Demand demand{"last packet to subscriber, p50", run_text(cell), "-", ms(kMostToSubscriberUs),
                Verdict::kNotMeasured};
  const ipc::LatencySummary& s = cell.run.packet_to_subscriber;
  if (s.count == 0) return demand;
  demand.measured = ms(s.p50_us) + ", p99 " + ms(s.p99_us);
  demand.verdict = s.p50_us <= kMostToSubscriberUs ? Verdict::kMet : Verdict::kMissed;
  return demand;
}

Demand identity(const IdentityCheck& check) {
  Demand demand{"same poses: " + check.name, "", check.remark, "", Verdict::kNotMeasured};
  if (check.verdict == IdentityCheck::Verdict::kPass) demand.verdict = Verdict::kMet;
  if (check.verdict == IdentityCheck::Verdict::kFail) demand.verdict = Verdict::kFailed;
  return demand;
}

const char* verdict_name(Verdict verdict) {
  switch (verdict) {
    case Verdict::kMet:
      return "met";
    case Verdict::kFailed:
      return "FAILED";
    case Verdict::kMissed:
      return "MISSED";
    case Verdict::kNotMeasured:
      break;
  }
  return "not measured";
}

}  // namespace

std::vector<Demand> judge_realtime(const RealtimeFigures& figures) {
  std::vector<Demand> demands;
  for (const CountedRun& run : figures.counted) demands.push_back(deadline_by_count(run));
  for (const RealtimeCell& cell : figures.cells) demands.push_back(deadline_by_clock(cell));
  const auto of_each_run = [&](Demand (*judge)(const RealtimeCell&)) {
    std::vector<Demand> runs;
    for (const RealtimeCell& cell : figures.cells) runs.push_back(judge(cell));
    add_for_all(std::move(runs), demands);
  };
  of_each_run(pose_per_scan);
  of_each_run(packets);
  for (const RealtimeCell& cell : figures.cells) {
    if (cell.condition == Condition::kHogs && !cell.budget_ms && cell.run.figures.scans_with_imu > 0)
      demands.push_back(imu_poses(cell));
  }
  of_each_run(allocations);
  demands.push_back(planted(figures.planted));
  for (const RealtimeCell& cell : figures.cells) {
    if (cell.condition == Condition::kIdle && !cell.budget_ms) demands.push_back(to_subscriber(cell));
  }
  for (const IdentityCheck& check : figures.checks) demands.push_back(identity(check));
  return demands;
}

BenchTable demand_table(std::span<const Demand> demands) {
  BenchTable table{{"asked", "run", "measured", "bound", "verdict"}, {}};
  for (const Demand& demand : demands)
    table.rows.push_back(
        {demand.asked, demand.run, demand.measured, demand.bound, verdict_name(demand.verdict)});
  return table;
}

bool any_failed(std::span<const Demand> demands) {
  return std::any_of(demands.begin(), demands.end(),
                     [](const Demand& demand) { return demand.verdict == Verdict::kFailed; });
}

}  // namespace nilio::tools
