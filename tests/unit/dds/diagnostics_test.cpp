#include "ipc/messages/diagnostics.hpp"

#include "nilio/core/imu_health.hpp"

#include "core/src/imu_monitor/check_table.hpp"
#include "tests/support/paths.hpp"

#include <algorithm>
#include <fstream>
#include <functional>
#include <iterator>
#include <map>
#include <string>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::dds;
using Level = DiagnosticStatus::Level;

namespace {

/// Inputs of one report that a test changes.
struct Report {
  ipc::PoseRecord latest;
  core::Duration age = core::Duration::from_milliseconds(50.0);
  PoseCounts period;

  Report() {
    latest.state = core::TrackingState::kTracking;
    latest.clock_source = core::ClockSource::kPpsLocked;
    latest.has_imu = true;
    latest.imu_health.trusted = true;
    period.poses = 10;
  }
  [[nodiscard]] DiagnosticStatus status(const std::string& group) const {
    for (const DiagnosticStatus& status : make_diagnostics({latest, age, period}, core::Time{1}).statuses) {
      if (status.name == "nilio: " + group) return status;
    }
    FAIL("no status " << group);
    return {};
  }
};

using Cause = std::function<void(Report&)>;

/// Cause that brings a row to a level.
struct Drive {
  std::string row;
  Level level;
  Cause cause;
};

const std::vector<Drive> kDrives{
    {"pose age", Level::kStale, [](Report& r) { r.age = core::Duration::from_seconds(1.1); }},
    {"state", Level::kWarn, [](Report& r) { r.latest.state = core::TrackingState::kInitialising; }},
    {"state", Level::kWarn, [](Report& r) { r.latest.state = core::TrackingState::kDegraded; }},
    {"state", Level::kError, [](Report& r) { r.latest.state = core::TrackingState::kLost; }},
    {"resets", Level::kWarn, [](Report& r) { r.period.resets = 1; }},
    {"packets", Level::kWarn, [](Report& r) { r.period.lost_packets = 99; }},
    {"packets", Level::kError, [](Report& r) { r.period.lost_packets = 100; }},
    {"points", Level::kError, [](Report& r) { r.latest.stop_reason = core::StopReason::kTooFewPoints; }},
    {"time source", Level::kWarn, [](Report& r) { r.latest.clock_source = core::ClockSource::kNmeaOnly; }},
    {"registration", Level::kWarn, [](Report& r) { r.period.cut_short = 1; }},
    {"registration", Level::kWarn, [](Report& r) { r.period.predicted_for_time = 1; }},
    {"registration", Level::kError, [](Report& r) { r.period.predicted_for_time = 2; }},
    {"scans skipped", Level::kWarn, [](Report& r) { r.period.superseded = 1; }},
    {"late poses", Level::kWarn, [](Report& r) { r.period.late = 1; }},
    {"failed writes", Level::kError, [](Report& r) { r.period.failed_writes = 1; }},
    {"poses dropped", Level::kWarn, [](Report& r) { r.period.ring_dropped = 1; }},
    {"use", Level::kWarn, [](Report& r) {
       r.latest.imu_health.trusted = false;
       r.latest.imu_health.reason = core::ImuCheck::kGyroAgreement;
     }}};

bool has_drive(const DiagnosticRow& row, Level level) {
  return std::any_of(kDrives.begin(), kDrives.end(),
                     [&](const Drive& drive) { return drive.row == row.name && drive.level == level; });
}

}  // namespace

TEST_CASE("a sound run has every diagnostic at ok", "[diagnostics]") {
  const Report report;
  const DiagnosticArray array = make_diagnostics({report.latest, report.age, report.period}, core::Time{7});
  CHECK(array.stamp == core::Time{7});
  std::vector<std::string> names;
  for (const DiagnosticStatus& status : array.statuses) {
    names.push_back(status.name);
    CHECK(status.level == Level::kOk);
  }
  CHECK(names == std::vector<std::string>{"nilio: odometry", "nilio: LiDAR", "nilio: compute", "nilio: DDS",
                                          "nilio: IMU"});
}

TEST_CASE("each row of the diagnostics has the level of its cause, and the status states value and remedy",
          "[diagnostics]") {
  for (const Drive& drive : kDrives) {
    CAPTURE(drive.row, static_cast<int>(drive.level));
    const auto rows = diagnostic_rows();
    const auto row =
        std::find_if(rows.begin(), rows.end(), [&](const DiagnosticRow& r) { return r.name == drive.row; });
    REQUIRE(row != rows.end());
    Report report;
    drive.cause(report);
    CHECK(row->find({report.latest, report.age, report.period}).level == drive.level);
    const DiagnosticStatus status = report.status(row->status);
    CHECK(status.level == drive.level);
    CHECK(status.message.find(std::string(row->name) + ": ") == 0);
    CHECK(status.message.find(row->remedy) != std::string::npos);
    // The groups do not disturb each other.
    for (const DiagnosticRow& other : rows) {
      if (std::string(other.status) != row->status) CHECK(report.status(other.status).level == Level::kOk);
    }
  }
}

TEST_CASE("every warning and error of the table is driven by the test above, and no row lacks a remedy",
          "[diagnostics]") {
  for (const DiagnosticRow& row : diagnostic_rows()) {
    CAPTURE(row.name);
    CHECK(has_drive(row, Level::kWarn) == (*row.warning != '\0'));
    const bool has_error = has_drive(row, Level::kError) || has_drive(row, Level::kStale);
    CHECK(has_error == (*row.error != '\0'));
    CHECK(*row.effect != '\0');
    CHECK(*row.remedy != '\0');
  }
}

TEST_CASE("each check of the IMU warns and is an error beyond its limits", "[diagnostics]") {
  for (std::size_t i = 0; i < core::kImuChecks; ++i) {
    const auto check = static_cast<core::ImuCheck>(i);
    CAPTURE(core::name_of(check));
    const core::ImuCheckLimits limits = core::limits_of(check);
    const auto level_at = [&](double distance) {
      Report report;
      core::set_row(report.latest.imu_health, check, core::normal_of(check) + distance);
      const DiagnosticStatus status = report.status("IMU");
      if (status.level != Level::kOk)
        CHECK(status.message.find(std::string("used; ") + core::name_of(check) + ": ") == 0);
      return status.level;
    };
    CHECK(level_at(0.0) == Level::kOk);
    CHECK(level_at(1.001 * limits.bad + 1e-6) == Level::kError);
    if (limits.warn < limits.bad) {
      CHECK(level_at(0.999 * limits.warn) == Level::kOk);
      CHECK(level_at(1.001 * limits.warn) == Level::kWarn);
    }
  }
}

TEST_CASE("poses are counted by what was wrong with them", "[diagnostics]") {
  PoseCounts counts;
  ipc::PoseRecord record;
  record.lost_packets = 3;
  record.superseded = 5;
  record.degradation_level = core::DegradationLevel::kFewerPoints;
  counts.add(record, ipc::OdometryReset::kNone);
  record.degradation_level = core::DegradationLevel::kNdtOnly;
  counts.add(record, ipc::OdometryReset::kInitialisation);
  record.degradation_level = core::DegradationLevel::kPredictionOnly;
  record.superseded = 6;
  const PoseCounts before = counts;
  counts.add(record, ipc::OdometryReset::kRelocalised);
  CHECK(counts.poses == 3);
  CHECK(counts.lost_packets == 9);
  CHECK(counts.cut_short == 1);
  CHECK(counts.predicted_for_time == 1);
  CHECK(counts.resets == 1);
  const PoseCounts period = counts - before;
  CHECK(period.poses == 1);
  CHECK(period.superseded == 1);
  CHECK(period.cut_short == 0);
}

TEST_CASE("docs/diagnostics.md is the generated table", "[diagnostics]") {
  std::ifstream file(nilio::tests::source_folder() + "/docs/diagnostics.md");
  const std::string text{std::istreambuf_iterator<char>(file), {}};
  INFO("regenerate with: nilio reference diagnostics > docs/diagnostics.md");
  CHECK(text == diagnostic_reference());
}
