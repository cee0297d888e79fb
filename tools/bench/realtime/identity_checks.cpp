#include "tools/bench/realtime/identity_checks.hpp"

#include "nilio/core/tracking.hpp"

#include "daemon/output/sha256.hpp"
#include "tools/bench/common/niliod_run.hpp"
#include "tools/bench/realtime/stress_load.hpp"
#include "tools/common/files.hpp"

#include <algorithm>
#include <optional>
#include <string_view>
#include <utility>

namespace nilio::tools::bench {

namespace {

namespace fs = std::filesystem;
using core::Result;

/// A busy computer drops packets at times, which makes runs incomparable.
constexpr int kAttempts = 3;
const std::string kUnlimited = "odometry.budget=off";
const std::string kCounted = "odometry.budget=ops";
const std::string kTight = "odometry.budget_ms=2";

std::string text_of(const fs::path& path) { return file_text(path).value_or(""); }

std::size_t lines_of(const std::string& text) {
  return static_cast<std::size_t>(std::count(text.begin(), text.end(), '\n'));
}

/// Reason why niliod did not get all packets that were sent; empty when it did.
std::string difference_of_input(const RealtimeRun& run) {
  const NiliodFigures& f = run.figures;
  const auto text = [](std::uint64_t count, const char* problem) { return std::to_string(count) + problem; };
  if (f.packets_lost > 0) return text(f.packets_lost, " packets were lost before niliod");
  if (f.packets_dropped > 0) return text(f.packets_dropped, " packets were dropped");
  if (run.sent && run.sent->packets_failed > 0)
    return text(run.sent->packets_failed, " packets were not sent");
  return {};
}

/// True when stamps do not depend on the arrival times of packets.
bool has_gps_time(const RealtimeRun& run) {
  return run.figures.clock_source == core::name_of(core::ClockSource::kPpsLocked) ||
         run.figures.clock_source == core::name_of(core::ClockSource::kNmeaOnly);
}
constexpr const char* kNoGpsTime = "stamps depend on arrival times, because the sensor has no GPS time";

class IdentityRuns {
 public:
  IdentityRuns(const SensorDrive& drive, const DrivePart& part, const RealtimeRunConfig& config,
               const fs::path& folder, StopSignals& signals)
      : drive_(drive), part_(part), config_(config), folder_(folder), signals_(signals) {}

  Result<IdentityCheck> file_and_loopback();
  Result<IdentityCheck> threads(const std::string& count);
  Result<IdentityCheck> loaded_and_idle();
  Result<IdentityCheck> overload_and_log(Feed feed);

 private:
  /// Replays the file. Returns the text of trajectory.kitti.
  Result<std::string> over_file(std::vector<std::string> overrides, const std::string& decisions = {});
  /// Overrides for a replay with the same input as the live run: no IMU where its frames are not sent.
  [[nodiscard]] std::vector<std::string> like_loopback(Feed feed) const;
  /// Trajectory of one thread on an idle computer with a counted budget.
  Result<std::string> reference();
  fs::path next_folder() { return folder_ / ("check" + std::to_string(runs_++)); }

  const SensorDrive& drive_;
  const DrivePart& part_;
  const RealtimeRunConfig& config_;
  const fs::path& folder_;
  StopSignals& signals_;
  int runs_ = 0;
  std::optional<std::string> reference_;
};

Result<std::string> IdentityRuns::over_file(std::vector<std::string> overrides,
                                            const std::string& decisions) {
  const fs::path folder = next_folder();
  overrides.insert(overrides.begin(), config_.overrides.begin(), config_.overrides.end());
  const auto run = run_niliod_over_file({part_.files, std::move(overrides), decisions}, folder, signals_);
  if (!run) return run.error();
  return text_of(folder / "trajectory.kitti");
}

Result<std::string> IdentityRuns::reference() {
  if (!reference_) {
    const Result<std::string> text = over_file({kCounted, kTight, "odometry.threads=1"});
    if (!text) return text.error();
    reference_ = *text;
  }
  return *reference_;
}

std::vector<std::string> IdentityRuns::like_loopback(Feed feed) const {
  if (feed == Feed::kReplay || !config_.can_interface.empty()) return {};
  return {"imu.enabled=false"};
}

IdentityCheck compare(const std::string& name, const std::string& first, const std::string& second) {
  IdentityCheck check{name, IdentityCheck::Verdict::kFail, daemon::sha256(first), daemon::sha256(second), {}};
  if (first.empty()) {
    check.remark = "no poses";
  } else if (first == second) {
    check.verdict = IdentityCheck::Verdict::kPass;
    check.remark = std::to_string(lines_of(first)) + " poses";
  } else {
    check.remark = "please report this";
  }
  return check;
}

Result<IdentityCheck> IdentityRuns::file_and_loopback() {
  const std::string name = "file = UDP loopback, no budget";
  std::vector<std::string> overrides = like_loopback(Feed::kUdp);
  overrides.push_back(kUnlimited);
  const Result<std::string> file = over_file(overrides);
  if (!file) return file.error();
  IdentityCheck check{name, IdentityCheck::Verdict::kNotComparable, daemon::sha256(*file), {}, {}};
  RealtimeRunConfig config = config_;
  config.feed = Feed::kUdp;
  config.condition = Condition::kIdle;
  config.overrides.push_back(kUnlimited);
  for (int i = 0; i < kAttempts; ++i) {
    const fs::path folder = next_folder();
    const auto run = run_niliod_in_real_time(drive_, part_, config, folder, signals_);
    if (!run) return run.error();
    check.remark = difference_of_input(*run);
    const std::string live = text_of(folder / "trajectory.kitti");
    check.second = daemon::sha256(live);
    if (!has_gps_time(*run)) {
      check.remark = kNoGpsTime;
      break;
    }
    if (!check.remark.empty()) continue;
    const std::uint64_t superseded = run->figures.superseded;
    if (superseded == 0) return compare_with_file(name, *file, live);
    // Superseded scans (sensor identification, overload) are only in the decision log.
    const Result<std::string> repeated = over_file(overrides, (folder / "decisions.jsonl").string());
    if (!repeated) return repeated.error();
    check = compare(name, *repeated, live);
    check.remark += ", " + std::to_string(superseded) + " superseded scans left out by the decision log";
    return check;
  }
  return check;
}

Result<IdentityCheck> IdentityRuns::threads(const std::string& count) {
  const Result<std::string> first = reference();
  if (!first) return first.error();
  const Result<std::string> second = over_file({kCounted, kTight, "odometry.threads=" + count});
  if (!second) return second.error();
  return compare("1 thread = " + count + " threads, counted 2 ms", *first, *second);
}

Result<IdentityCheck> IdentityRuns::loaded_and_idle() {
  const Result<std::string> first = reference();
  if (!first) return first.error();
  const Result<StressLoad> load = StressLoad::cpu_load(kLoadProcesses);
  if (!load) return load.error();
  const Result<std::string> second = over_file({kCounted, kTight, "odometry.threads=1"});
  if (!second) return second.error();
  return compare("idle = CPU load, counted 2 ms", *first, *second);
}

Result<IdentityCheck> IdentityRuns::overload_and_log(Feed feed) {
  const std::string name = std::string("live run, 2 ms and CPU load = its decision log, ") +
                           (feed == Feed::kUdp ? "UDP" : "--as-live");
  RealtimeRunConfig config = config_;
  config.feed = feed;
  config.condition = Condition::kCpuLoad;
  config.overrides.insert(config.overrides.end(), {"odometry.budget=wall", kTight});
  IdentityCheck check{name, IdentityCheck::Verdict::kNotComparable, {}, {}, {}};
  for (int i = 0; i < kAttempts; ++i) {
    const fs::path folder = next_folder();
    const auto run = run_niliod_in_real_time(drive_, part_, config, folder, signals_);
    if (!run) return run.error();
    check.remark = difference_of_input(*run);
    const std::string live = text_of(folder / "trajectory.kitti");
    check.first = daemon::sha256(live);
    if (run->sent && !has_gps_time(*run)) {
      check.remark = kNoGpsTime;
      break;
    }
    if (!check.remark.empty()) continue;
    std::vector<std::string> overrides = like_loopback(feed);
    overrides.insert(overrides.end(), {"odometry.budget=wall", kTight});
    const Result<std::string> repeated = over_file(overrides, (folder / "decisions.jsonl").string());
    if (!repeated) return repeated.error();
    check = compare(name, live, *repeated);
    check.remark += ", " + std::to_string(run->figures.superseded) + " superseded, " +
                    std::to_string(run->figures.predicted_by_guard) + " predicted by the guard";
    return check;
  }
  return check;
}

const char* verdict_name(IdentityCheck::Verdict verdict) {
  switch (verdict) {
    case IdentityCheck::Verdict::kPass:
      return "PASS";
    case IdentityCheck::Verdict::kFail:
      return "FAIL";
    case IdentityCheck::Verdict::kNotComparable:
      break;
  }
  return "not comparable";
}

}  // namespace

std::string sha256_of_lines(const std::string& text, std::size_t lines) {
  std::size_t end = 0;
  for (std::size_t i = 0; i < lines && end < text.size(); ++i) {
    const std::size_t newline = text.find('\n', end);
    end = newline == std::string::npos ? text.size() : newline + 1;
  }
  return daemon::sha256(std::string_view(text).substr(0, end));
}

IdentityCheck compare_with_file(const std::string& name, const std::string& file_kitti,
                                const std::string& live_kitti) {
  const std::size_t in_file = lines_of(file_kitti);
  const std::size_t live = lines_of(live_kitti);
  IdentityCheck check;
  check.name = name;
  check.first = sha256_of_lines(file_kitti, live);
  check.second = daemon::sha256(live_kitti);
  check.remark = std::to_string(live) + " poses of the file's " + std::to_string(in_file);
  const bool complete = live > 0 && live <= in_file && in_file - live <= 1;
  check.verdict =
      complete && check.first == check.second ? IdentityCheck::Verdict::kPass : IdentityCheck::Verdict::kFail;
  return check;
}

Result<std::vector<IdentityCheck>> check_identities(const SensorDrive& drive, const DrivePart& part,
                                                    const RealtimeRunConfig& config, const fs::path& folder,
                                                    StopSignals& signals) {
  IdentityRuns runs(drive, part, config, folder, signals);
  std::vector<IdentityCheck> checks;
  const auto keep = [&checks](Result<IdentityCheck> check) -> Result<std::monostate> {
    if (!check) return check.error();
    checks.push_back(std::move(check).value());
    return std::monostate{};
  };
  if (auto kept = keep(runs.file_and_loopback()); !kept) return kept.error();
  for (const char* count : {"2", "4"}) {
    if (auto kept = keep(runs.threads(count)); !kept) return kept.error();
  }
  if (auto kept = keep(runs.loaded_and_idle()); !kept) return kept.error();
  for (const Feed feed : {Feed::kReplay, Feed::kUdp}) {
    if (auto kept = keep(runs.overload_and_log(feed)); !kept) return kept.error();
  }
  return checks;
}

Table identity_table(std::span<const IdentityCheck> checks) {
  Table table{{"check", "verdict", "first", "second", "remark"}, {}};
  for (const IdentityCheck& check : checks)
    table.rows.push_back({check.name, verdict_name(check.verdict), check.first, check.second, check.remark});
  return table;
}

bool any_failed(std::span<const IdentityCheck> checks) {
  return std::any_of(checks.begin(), checks.end(), [](const IdentityCheck& check) {
    return check.verdict == IdentityCheck::Verdict::kFail;
  });
}

}  // namespace nilio::tools::bench
