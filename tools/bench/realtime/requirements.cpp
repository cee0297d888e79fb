#include "tools/bench/realtime/requirements.hpp"

#include <algorithm>
#include <utility>

namespace nilio::tools::bench {

namespace {

using Verdict = Requirement::Verdict;

constexpr double kMillisecondUs = 1000.0;
constexpr double kMaxImuPoseUs = 1000.0;
constexpr double kMaxToSubscriberUs = 10'000.0;
/// Of DDS and a wake-up, beyond the budget.
constexpr double kMaxToReaderUs = 5000.0;
constexpr double kMaxStopS = 2.0;
/// Errors below this are equal for a user.
constexpr double kNegligiblePercent = 0.1;
/// Calls of the control run: an allocation, a release and a lock.
constexpr std::uint64_t kPlanted = 3;

std::string us(double value) { return fixed(value, 0) + " us"; }
std::string ms(double value_us) { return fixed(value_us / kMillisecondUs, 2) + " ms"; }

bool has(const std::optional<ipc::LatencySummary>& summary) { return summary && summary->count > 0; }

/// A disk that takes a second for a write does not get the report of a run that ends within two.
bool has_report(const RealtimeCell& cell) {
  return cell.condition != Condition::kSlowDisk || cell.run.figures.budget_ms.has_value();
}

Requirement not_reported(Requirement requirement) {
  requirement.measured = "no report";
  requirement.bound = "-";
  requirement.verdict = Verdict::kNotMeasured;
  return requirement;
}

Requirement deadline_by_count(const CountedRun& run) {
  Requirement requirement{"beyond the budget, p99: less than an iteration, counted",
                          fixed(run.budget_ms, 0) + " ms", "-", "-", Verdict::kNotMeasured};
  const NiliodFigures& f = run.figures;
  if (!has(f.overshoot) || !has(f.iteration)) return requirement;
  requirement.measured = us(f.overshoot->p99_us);
  requirement.bound = us(f.iteration->p50_us);
  requirement.verdict = f.overshoot->p99_us < f.iteration->p50_us ? Verdict::kMet : Verdict::kFailed;
  return requirement;
}

Requirement deadline_by_clock(const RealtimeCell& cell) {
  Requirement requirement{"beyond the budget, p99: less than an iteration plus wake-up latency",
                          run_text(cell), "-", "-", Verdict::kNotMeasured};
  const NiliodFigures& f = cell.run.figures;
  if (!has(f.overshoot) || !has(f.iteration)) return requirement;
  requirement.measured = us(f.overshoot->p99_us);
  requirement.bound = us(f.iteration->p50_us) + " + " + us(cell.run.wakeup.p99_us);
  requirement.verdict =
      f.overshoot->p99_us < f.iteration->p50_us + cell.run.wakeup.p99_us ? Verdict::kMet : Verdict::kMissed;
  return requirement;
}

/// Superseded scans have no pose and are counted. They occur during the sensor identification, or when niliod
/// did not run for as long as a scan.
Requirement pose_per_scan(const RealtimeCell& cell) {
  const NiliodFigures& f = cell.run.figures;
  Requirement requirement{"one pose per scan", run_text(cell), std::to_string(f.poses),
                          std::to_string(f.scans), Verdict::kFailed};
  if (!has_report(cell)) return not_reported(requirement);
  if (f.superseded > 0) requirement.bound += ", " + std::to_string(f.superseded) + " superseded";
  if (f.poses > 0 && f.poses + f.superseded == f.scans)
    requirement.verdict = f.superseded == 0 ? Verdict::kMet : Verdict::kMissed;
  return requirement;
}

Requirement packets(const RealtimeCell& cell) {
  const NiliodFigures& f = cell.run.figures;
  const std::uint64_t lost = f.packets_lost + f.packets_dropped;
  const Requirement requirement{"no packet lost", run_text(cell), std::to_string(lost), "0",
                                lost == 0 ? Verdict::kMet : Verdict::kMissed};
  return has_report(cell) ? requirement : not_reported(requirement);
}

/// Adds one line for all runs with a report when all met the requirement, otherwise one for each.
void add_for_all(std::vector<Requirement> runs, std::vector<Requirement>& requirements) {
  const auto reported = std::stable_partition(runs.begin(), runs.end(), [](const Requirement& requirement) {
    return requirement.verdict != Verdict::kNotMeasured;
  });
  const std::vector<Requirement> unreported(reported, runs.end());
  runs.erase(reported, runs.end());
  const bool all_met = std::all_of(runs.begin(), runs.end(), [](const Requirement& requirement) {
    return requirement.verdict == Verdict::kMet;
  });
  if (all_met && runs.size() > 1) {
    Requirement& first = runs.front();
    first.run = "each of " + std::to_string(runs.size());
    const bool is_same = std::all_of(runs.begin(), runs.end(), [&first](const Requirement& requirement) {
      return requirement.measured == first.measured && requirement.bound == first.bound;
    });
    if (!is_same) first.measured = first.bound = "see the tables";
    runs.resize(1);
  }
  requirements.insert(requirements.end(), runs.begin(), runs.end());
  requirements.insert(requirements.end(), unreported.begin(), unreported.end());
}

Requirement imu_poses(const RealtimeCell& cell) {
  Requirement requirement{"pose at IMU rate, p99: within 1 ms plus wake-up latency", run_text(cell), "-", "-",
                          Verdict::kNotMeasured};
  if (!has(cell.run.imu_pose)) return requirement;
  requirement.measured = us(cell.run.imu_pose->p99_us);
  requirement.bound = us(kMaxImuPoseUs) + " + " + us(cell.run.wakeup.p99_us);
  requirement.verdict =
      cell.run.imu_pose->p99_us <= kMaxImuPoseUs + cell.run.wakeup.p99_us ? Verdict::kMet : Verdict::kMissed;
  return requirement;
}

Requirement allocations(const RealtimeCell& cell) {
  Requirement requirement{"allocations, locks, exceptions, output in real-time threads", run_text(cell),
                          cell.run.why_not_watched, "0", Verdict::kNotMeasured};
  if (!cell.run.watch) return requirement;
  const std::uint64_t count = forbidden_calls(*cell.run.watch);
  requirement.measured = std::to_string(count);
  requirement.verdict = count == 0 ? Verdict::kMet : Verdict::kFailed;
  return requirement;
}

Requirement planted(const ThreadWatch* watch) {
  Requirement requirement{"control run: allocation, release and lock in the odometry thread are counted",
                          "replay", "-", std::to_string(kPlanted), Verdict::kNotMeasured};
  if (watch == nullptr) return requirement;
  requirement.measured = std::to_string(forbidden_calls(*watch));
  requirement.verdict = forbidden_calls(*watch) == kPlanted ? Verdict::kMet : Verdict::kFailed;
  return requirement;
}

Requirement to_subscriber(const RealtimeCell& cell) {
  Requirement requirement{"last packet to subscriber, p50", run_text(cell), "-", ms(kMaxToSubscriberUs),
                          Verdict::kNotMeasured};
  const ipc::LatencySummary& s = cell.run.packet_to_subscriber;
  if (s.count == 0) return requirement;
  requirement.measured = ms(s.p50_us) + ", p99 " + ms(s.p99_us);
  requirement.verdict = s.p50_us <= kMaxToSubscriberUs ? Verdict::kMet : Verdict::kMissed;
  return requirement;
}

Requirement to_reader(const RealtimeCell& cell) {
  Requirement requirement{"last packet to an independent reader, p99: within the budget and 5 ms",
                          run_text(cell), cell.run.why_no_reader, "-", Verdict::kNotMeasured};
  const std::optional<double>& budget_ms = cell.run.figures.budget_ms;
  if (!cell.run.reader || cell.run.reader->packet_to_reader.count == 0 || !budget_ms) return requirement;
  const ipc::LatencySummary& s = cell.run.reader->packet_to_reader;
  const double bound_us = *budget_ms * kMillisecondUs + kMaxToReaderUs;
  requirement.measured = ms(s.p99_us) + ", p50 " + ms(s.p50_us);
  requirement.bound = ms(bound_us);
  requirement.verdict = s.p99_us <= bound_us ? Verdict::kMet : Verdict::kMissed;
  return requirement;
}

/// The poses of packets sent over UDP; a replay may begin before the reader is matched.
Requirement reader_poses(const RealtimeCell& cell) {
  Requirement requirement{"every pose at an independent reader", run_text(cell), cell.run.why_no_reader, "-",
                          Verdict::kNotMeasured};
  const NiliodFigures& f = cell.run.figures;
  if (!cell.run.reader || f.poses == 0) return requirement;
  requirement.measured = std::to_string(cell.run.reader->poses);
  requirement.bound = std::to_string(f.poses);
  requirement.verdict = cell.run.reader->poses >= f.poses ? Verdict::kMet : Verdict::kMissed;
  return requirement;
}

Requirement stopping(const RealtimeCell& cell) {
  Requirement requirement{"SIGTERM ends niliod within 2 s", run_text(cell), "-", fixed(kMaxStopS, 1) + " s",
                          Verdict::kNotMeasured};
  if (!cell.run.stop_s) return requirement;
  requirement.measured = fixed(*cell.run.stop_s, 1) + " s";
  requirement.verdict = *cell.run.stop_s <= kMaxStopS ? Verdict::kMet : Verdict::kMissed;
  return requirement;
}

/// Only on the files of a run that could write them.
Requirement files(const RealtimeCell& cell) {
  const NiliodFigures& f = cell.run.figures;
  const std::size_t written = f.trajectory.poses.size();
  return {"every pose in trajectory.tum", run_text(cell), std::to_string(written),
          f.poses > 0 ? std::to_string(f.poses) : "not written",
          f.poses > 0 && written == f.poses ? Verdict::kMet : Verdict::kMissed};
}

Requirement accuracy(const RealtimeCell& cell, const AccuracyReference& reference) {
  Requirement requirement{"accuracy by the clock, t %, 10-80 m: at most twice that of the whole computation",
                          run_text(cell), "-", "-", Verdict::kNotMeasured};
  const std::optional<double>& whole = cell.feed == Feed::kUdp ? reference.udp : reference.replay;
  if (!whole || !cell.translation_percent) return requirement;
  const double bound = std::max(2.0 * *whole, kNegligiblePercent);
  requirement.measured = fixed(*cell.translation_percent, 3);
  requirement.bound = fixed(bound, 3);
  requirement.verdict = *cell.translation_percent <= bound ? Verdict::kMet : Verdict::kMissed;
  return requirement;
}

Requirement identity(const IdentityCheck& check) {
  Requirement requirement{"same poses: " + check.name, "", check.remark, "", Verdict::kNotMeasured};
  if (check.verdict == IdentityCheck::Verdict::kPass) requirement.verdict = Verdict::kMet;
  if (check.verdict == IdentityCheck::Verdict::kFail) requirement.verdict = Verdict::kFailed;
  return requirement;
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

std::vector<Requirement> check_requirements(const RealtimeFigures& figures) {
  std::vector<Requirement> requirements;
  // The configured budget, and the number of scans, are those of the other runs.
  const auto expected = [&](RealtimeCell cell) {
    const auto alike = std::find_if(figures.cells.begin(), figures.cells.end(), [&](const auto& other) {
      return has_report(other) && other.feed == cell.feed && other.budget_ms == cell.budget_ms;
    });
    if (!has_report(cell) && alike != figures.cells.end()) {
      cell.run.figures.budget_ms = alike->run.figures.budget_ms;
      cell.run.figures.poses = alike->run.figures.poses;
    }
    return cell;
  };
  for (const CountedRun& run : figures.counted) requirements.push_back(deadline_by_count(run));
  for (const RealtimeCell& cell : figures.cells) requirements.push_back(deadline_by_clock(cell));
  for (const RealtimeCell& cell : figures.cells) requirements.push_back(accuracy(cell, figures.reference));
  const auto of_each_run = [&](Requirement (*check)(const RealtimeCell&)) {
    std::vector<Requirement> runs;
    for (const RealtimeCell& cell : figures.cells) runs.push_back(check(cell));
    add_for_all(std::move(runs), requirements);
  };
  of_each_run(pose_per_scan);
  of_each_run(packets);
  std::vector<Requirement> at_reader;
  for (const RealtimeCell& cell : figures.cells) at_reader.push_back(reader_poses(expected(cell)));
  add_for_all(std::move(at_reader), requirements);
  for (const RealtimeCell& cell : figures.cells) {
    if (!cell.budget_ms) requirements.push_back(to_reader(expected(cell)));
  }
  for (const RealtimeCell& cell : figures.cells) {
    const bool bad_disk = cell.condition == Condition::kSlowDisk || cell.condition == Condition::kFullDisk;
    if (bad_disk) requirements.push_back(files(cell));
    if (bad_disk || cell.condition == Condition::kUrgentLoad) requirements.push_back(stopping(cell));
  }
  for (const RealtimeCell& cell : figures.cells) {
    if (cell.condition == Condition::kCpuLoad && !cell.budget_ms && cell.run.figures.scans_with_imu > 0)
      requirements.push_back(imu_poses(cell));
  }
  of_each_run(allocations);
  requirements.push_back(planted(figures.planted));
  for (const RealtimeCell& cell : figures.cells) {
    if (cell.condition == Condition::kIdle && !cell.budget_ms) requirements.push_back(to_subscriber(cell));
  }
  for (const IdentityCheck& check : figures.checks) requirements.push_back(identity(check));
  return requirements;
}

Table requirement_table(std::span<const Requirement> requirements) {
  Table table{{"requirement", "run", "measured", "bound", "verdict"}, {}};
  for (const Requirement& requirement : requirements)
    table.rows.push_back({requirement.name, requirement.run, requirement.measured, requirement.bound,
                          verdict_name(requirement.verdict)});
  return table;
}

bool any_failed(std::span<const Requirement> requirements) {
  return std::any_of(requirements.begin(), requirements.end(),
                     [](const Requirement& requirement) { return requirement.verdict == Verdict::kFailed; });
}

}  // namespace nilio::tools::bench
