#include "ipc/messages/diagnostics.hpp"

#include "nilio/core/compute_budget.hpp"
#include "nilio/core/imu_health.hpp"
#include "nilio/core/tracking.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <string>
#include <string_view>
#include <vector>

namespace nilio::dds {
namespace {

using core::ImuCheck;
using core::ImuCheckState;
using core::StopReason;
using core::TrackingState;
using Level = DiagnosticStatus::Level;
using Input = DiagnosticInput;
using Finding = DiagnosticFinding;

constexpr core::Duration kStaleAfter{1'000'000'000};
/// Mean number of packets that a scan lacks.
constexpr std::uint64_t kManyLostPackets = 10;
/// One pose in so many is predicted for lack of time.
constexpr std::uint64_t kFewPredicted = 10;

constexpr std::string_view kOdometry = "odometry";
constexpr std::string_view kImu = "IMU";

std::string text_of(double value) {
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "%.4g", value);
  return text.data();
}

Finding find_age(const Input& input) {
  const bool is_stale = input.age > kStaleAfter;
  return {is_stale ? Level::kStale : Level::kOk, "no pose for " + text_of(input.age.seconds()) + " s"};
}

Finding find_state(const Input& input) {
  const TrackingState state = input.latest.state;
  const Level level = state == TrackingState::kTracking ? Level::kOk
                      : state == TrackingState::kLost   ? Level::kError
                                                        : Level::kWarn;
  return {level, core::name_of(state)};
}

Finding find_resets(const Input& input) {
  const std::uint64_t resets = input.period.resets;
  return {resets > 0 ? Level::kWarn : Level::kOk, std::to_string(resets) + " since the last report"};
}

Finding find_packets(const Input& input) {
  const PoseCounts& period = input.period;
  const Level level = period.lost_packets == 0 ? Level::kOk
                      : period.lost_packets >= kManyLostPackets * std::max<std::uint64_t>(period.poses, 1)
                          ? Level::kError
                          : Level::kWarn;
  return {level, std::to_string(period.lost_packets) + " lost in " + std::to_string(period.poses) + " scans"};
}

Finding find_points(const Input& input) {
  const bool too_few = input.latest.stop_reason == StopReason::kTooFewPoints;
  return {too_few ? Level::kError : Level::kOk, std::to_string(input.latest.points) + " in the scan, " +
                                                    std::to_string(input.latest.points_used) + " registered"};
}

Finding find_clock(const Input& input) {
  const bool lacks_pulse = input.latest.clock_source == core::ClockSource::kNmeaOnly;
  return {lacks_pulse ? Level::kWarn : Level::kOk, core::name_of(input.latest.clock_source)};
}

Finding find_registration(const Input& input) {
  const PoseCounts& period = input.period;
  const Level level = period.predicted_for_time * kFewPredicted > period.poses ? Level::kError
                      : period.predicted_for_time + period.cut_short > 0       ? Level::kWarn
                                                                               : Level::kOk;
  return {level, std::to_string(period.cut_short) + " cut short, " +
                     std::to_string(period.predicted_for_time) + " predicted in " +
                     std::to_string(period.poses) + " poses"};
}

/// A count of the period, with the level that any of them has.
Finding count_finding(std::uint64_t count, Level level) {
  return {count > 0 ? level : Level::kOk, std::to_string(count) + " since the last report"};
}

Finding find_superseded(const Input& input) { return count_finding(input.period.superseded, Level::kWarn); }
Finding find_late(const Input& input) { return count_finding(input.period.late, Level::kWarn); }
Finding find_failed_writes(const Input& input) {
  return count_finding(input.period.failed_writes, Level::kError);
}
Finding find_dropped(const Input& input) { return count_finding(input.period.ring_dropped, Level::kWarn); }

Finding find_imu_use(const Input& input) {
  const core::ImuHealth& health = input.latest.imu_health;
  if (health.trusted) return {Level::kOk, "used"};
  if (health.reason == ImuCheck::kCount) return {Level::kOk, "not used, not yet confirmed by a turn"};
  return {Level::kWarn, std::string("not used because of ") + core::name_of(health.reason)};
}

constexpr std::array kRows{
    DiagnosticRow{
        "odometry", "pose age", "", "no pose for 1 s (level stale)", "no pose is published",
        "read niliod's line 'no scan for ...': power and cable of the LiDAR, its port, the sender's address",
        find_age},
    DiagnosticRow{"odometry", "state", "initialising or degraded", "lost",
                  "degraded: the pose follows the prediction in part or as a whole and its covariance grows, "
                  "or it is not known to 0.10 m; lost: it is no longer reliable",
                  "see the states in docs/states.md; drive on slowly where there is structure, and check the "
                  "LiDAR's view and mounting",
                  find_state},
    DiagnosticRow{"odometry", "resets", "the map was reset or the pose was relocalised since the last report",
                  "", "the pose jumps; after a map reset, poses before and after do not fit together",
                  "read the reason in niliod's log; treat the route before as another one", find_resets},
    DiagnosticRow{"LiDAR", "packets", "a packet was lost since the last report",
                  "10 or more packets lost per scan", "sectors of the scan are missing",
                  "check cable and switch, net.core.rmem_max and the load of the computer", find_packets},
    DiagnosticRow{"LiDAR", "points", "", "too few points to register the scan", "the pose is the prediction",
                  "remove what covers the sensor; check lidar.min_range_m and lidar.max_range_m",
                  find_points},
    DiagnosticRow{"LiDAR", "time source", "nmea_only: GPS time without a pulse", "",
                  "stamps of the LiDAR are exact to milliseconds only",
                  "connect the receiver's pulse (PPS) to the sensor", find_clock},
    DiagnosticRow{"compute", "registration",
                  "a pose was registered with NDT or ICP only, or predicted, for lack of time",
                  "more than a tenth of the poses were predicted for lack of time",
                  "less accurate poses; predicted ones ignore the scan",
                  "give niliod more CPU time (realtime.*, odometry.threads), or lower odometry.scan_points",
                  find_registration},
    DiagnosticRow{"compute", "scans skipped", "a scan was skipped for a newer one", "", "fewer poses",
                  "as for registration; check what else runs on the processors of realtime.odometry_cpus",
                  find_superseded},
    DiagnosticRow{"compute", "late poses", "a pose was delivered after its deadline", "",
                  "latency above odometry.budget_ms", "as for registration; see latency.json for the stage",
                  find_late},
    DiagnosticRow{"DDS", "failed writes", "", "Fast DDS refused to write a pose", "subscribers miss poses",
                  "restart nilio-publisher; if it persists, check the log of Fast DDS above it",
                  find_failed_writes},
    DiagnosticRow{"DDS", "poses dropped", "poses were dropped because nilio-publisher did not read them", "",
                  "subscribers miss poses",
                  "check the CPU load; a publisher that hangs is restarted after 5 s", find_dropped},
    DiagnosticRow{"IMU", "use", "the IMU is rejected", "",
                  "rotation is predicted at a constant rate; fast turns are less accurate",
                  "correct what the check named in the value reports", find_imu_use}};

/// Effect of a bad check, in the order of ImuCheck.
constexpr std::array<const char*, core::kImuChecks> kImuEffects{
    "the IMU is not used once a constant rate predicts better",
    "neither gyroscope nor accelerometer is used",
    "neither gyroscope nor accelerometer is used",
    "the gyroscope is not used",
    "none: the bias is estimated and subtracted",
    "the gyroscope is not used",
    "the gyroscope is not used for the scans in which it clips",
    "the gyroscope is not used meanwhile",
    "the accelerometer is not used",
    "the accelerometer is not used",
    "the accelerometer is not used",
    "none while the gyroscope predicts well",
    "the accelerometer is not used for the scans in which it clips",
    "the accelerometer is not used meanwhile",
    "the IMU is not used unless the offset could be estimated and subtracted",
    "none while gaps stay below odometry.max_imu_gap_ms",
    "scans in the gap are predicted without the IMU"};

Level level_of(ImuCheckState state) {
  if (state == ImuCheckState::kBad) return Level::kError;
  return state == ImuCheckState::kWarn ? Level::kWarn : Level::kOk;
}

/// Values that help to understand the rows; none of them has a level.
void add_odometry_values(const ipc::PoseRecord& latest, DiagnosticStatus& status) {
  const auto& v = latest.linear_velocity;
  const std::vector<KeyValue> values{{"speed, m/s", text_of(std::hypot(v[0], v[1], v[2]))},
                                     {"stop reason", core::name_of(latest.stop_reason)},
                                     {"correspondences", std::to_string(latest.correspondences)},
                                     {"map voxels", std::to_string(latest.map_voxels)},
                                     {"IMU used", latest.imu_used ? "yes" : "no"}};
  status.values.insert(status.values.end(), values.begin(), values.end());
}

void raise(DiagnosticStatus& status, Level level, const std::string& message) {
  if (level <= status.level) return;
  status.level = level;
  status.message = message;
}

/// Adds a value per check; the first of the worst gives level and message.
void add_imu_checks(const core::ImuHealth& health, DiagnosticStatus& status) {
  const std::string use = status.values.front().value;
  for (std::size_t i = 0; i < core::kImuChecks; ++i) {
    const auto check = static_cast<ImuCheck>(i);
    const core::ImuDiagnosis& row = health[check];
    const std::string value =
        row.state == ImuCheckState::kUnknown ? "" : text_of(row.value) + " " + core::unit_of(check) + ", ";
    status.values.push_back({core::name_of(check), value + core::name_of(row.state)});
    raise(status, level_of(row.state),
          use + "; " + core::name_of(check) + ": " + core::hint_for(check, health));
  }
  status.values.push_back({"time shift subtracted from its stamps, ms", text_of(health.time_shift_ms)});
  status.values.push_back({"rejections", std::to_string(health.demotions)});
}

DiagnosticStatus make_status(std::string_view name, const Input& input) {
  DiagnosticStatus status;
  status.name = "nilio: " + std::string(name);
  for (const DiagnosticRow& row : kRows) {
    if (row.status != name) continue;
    const Finding finding = row.find(input);
    if (status.message.empty()) status.message = finding.level == Level::kOk ? "" : finding.value;
    raise(status, finding.level, std::string(row.name) + ": " + finding.value + " - " + row.remedy);
    status.values.push_back({row.name, finding.value});
  }
  if (name == kOdometry) add_odometry_values(input.latest, status);
  if (name == kImu) add_imu_checks(input.latest.imu_health, status);
  if (status.level == Level::kOk) status.message = name == kImu ? status.values.front().value : "ok";
  return status;
}

}  // namespace

void PoseCounts::add(const ipc::PoseRecord& record, ipc::OdometryReset reset) {
  using core::DegradationLevel;
  const DegradationLevel level = record.degradation_level;
  ++poses;
  lost_packets += record.lost_packets;
  if (record.guarded || level == DegradationLevel::kPredictionOnly) {
    ++predicted_for_time;
  } else if (level >= DegradationLevel::kIcpOnly) {
    ++cut_short;
  }
  superseded = record.superseded;
  if (reset > ipc::OdometryReset::kInitialisation) ++resets;
}

PoseCounts operator-(PoseCounts later, const PoseCounts& earlier) {
  constexpr std::array kCounts{&PoseCounts::poses,       &PoseCounts::lost_packets,
                               &PoseCounts::cut_short,   &PoseCounts::predicted_for_time,
                               &PoseCounts::superseded,  &PoseCounts::resets,
                               &PoseCounts::late,        &PoseCounts::failed_writes,
                               &PoseCounts::ring_dropped};
  static_assert(sizeof(PoseCounts) == kCounts.size() * sizeof(std::uint64_t));
  for (const auto member : kCounts) later.*member -= std::min(later.*member, earlier.*member);
  return later;
}

std::span<const DiagnosticRow> diagnostic_rows() { return kRows; }

DiagnosticArray make_diagnostics(const DiagnosticInput& input, core::Time now) {
  DiagnosticArray diagnostics;
  diagnostics.stamp = now;
  std::string_view last;
  for (const DiagnosticRow& row : kRows) {
    if (row.status == last || (row.status == kImu && !input.latest.has_imu)) continue;
    last = row.status;
    diagnostics.statuses.push_back(make_status(row.status, input));
  }
  return diagnostics;
}

std::string diagnostic_reference() {
  std::string text =
      "<!-- Generated: nilio reference diagnostics > docs/diagnostics.md -->\n\n"
      "# Diagnostics\n\n"
      "`nilio-publisher` publishes these rows once per second as `diagnostic_msgs/DiagnosticArray` on "
      "`/diagnostics`: one status per\ngroup (`nilio: odometry`, ...), one value per row. The level of a "
      "status is "
      "the worst of its rows, and its message is the\nvalue and remedy of that row. **Error** means that the "
      "output "
      "is missing or wrong until somebody acts; a **warning** says that\nit is less good, or that nilio "
      "continues by "
      "itself. The same rule holds for the levels of the log. States and resets:\n[states.md](states.md). "
      "Exit "
      "statuses: [exit_status.md](exit_status.md).\n\n"
      "| group | value | warning when | error when | effect on the output | what to do "
      "|\n|---|---|---|---|---|---|\n";
  const auto cell = [](const char* value) { return *value == '\0' ? std::string("-") : std::string(value); };
  for (const DiagnosticRow& row : kRows)
    text += std::string("| ") + row.status + " | " + row.name + " | " + cell(row.warning) + " | " +
            cell(row.error) + " | " + row.effect + " | " + row.remedy + " |\n";
  text +=
      "\n## Checks of the IMU\n\n"
      "Values of the status `nilio: IMU`, and under `imu` in `latency.json`. Limits hold for the distance "
      "from the "
      "value of a sound\nIMU; a row returns to a better state below 0.8 times the limit. A limit of 0: an "
      "error as "
      "soon as it occurs. The remedy is\nshown for a value just beyond the limit.\n\n"
      "| value | sound | warning above | error above | effect of the error | what to do "
      "|\n|---|---:|---:|---:|---|---|\n";
  for (std::size_t i = 0; i < core::kImuChecks; ++i) {
    const auto check = static_cast<ImuCheck>(i);
    const core::ImuCheckLimits limits = core::limits_of(check);
    core::ImuHealth health;
    health.rows[i].state = ImuCheckState::kBad;
    health.rows[i].value = core::normal_of(check) + limits.bad;
    const std::string unit =
        core::unit_of(check) == std::string_view("1") ? "" : std::string(" ") + core::unit_of(check);
    text += std::string("| `") + core::name_of(check) + "` | " + text_of(core::normal_of(check)) + unit +
            " | " + text_of(limits.warn) + unit + " | " + text_of(limits.bad) + unit + " | " +
            kImuEffects[i] + " | " + core::hint_for(check, health) + " |\n";
  }
  return text;
}

}  // namespace nilio::dds
