#pragma once

#include "nilio/core/time.hpp"

#include "ipc/messages/messages.hpp"
#include "ipc/odometry_resets.hpp"
#include "ipc/records.hpp"

#include <cstdint>
#include <span>
#include <string>

namespace nilio::dds {

/// Counts over the poses of a time; those of a report period are the difference of two sums.
struct PoseCounts {
  std::uint64_t poses = 0;
  std::uint64_t lost_packets = 0;
  std::uint64_t cut_short = 0;           ///< registered with NDT or ICP only, for lack of time
  std::uint64_t predicted_for_time = 0;  ///< predicted because there was no time to register
  std::uint64_t superseded = 0;          ///< scans skipped for newer ones
  std::uint64_t resets = 0;              ///< map resets after initialisation, and relocalisations
  std::uint64_t late = 0;                ///< written after their deadline, initialisation excluded
  std::uint64_t failed_writes = 0;
  std::uint64_t ring_dropped = 0;

  /// Adds one pose with the discontinuity at it; the last three counts belong to the writer.
  void add(const ipc::PoseRecord& record, ipc::OdometryReset reset);
  friend PoseCounts operator-(PoseCounts later, const PoseCounts& earlier);
};

struct DiagnosticInput {
  const ipc::PoseRecord& latest;
  core::Duration age;   ///< since `latest` was taken from the ring
  PoseCounts period{};  ///< since the last report
};

/// Level and value of one row.
struct DiagnosticFinding {
  DiagnosticStatus::Level level = DiagnosticStatus::Level::kOk;
  std::string value;
};

/// Row of the table of diagnostics, from which messages and docs/diagnostics.md are made. The rows of the
/// IMU's checks come from core.
struct DiagnosticRow {
  const char* status;   ///< "odometry": DiagnosticStatus::name without "nilio: "
  const char* name;     ///< key of the value
  const char* warning;  ///< when; empty: never
  const char* error;
  const char* effect;  ///< on the output
  const char* remedy;
  DiagnosticFinding (*find)(const DiagnosticInput& input);
};

/// All rows but the IMU's checks.
std::span<const DiagnosticRow> diagnostic_rows();

/// One status per group of rows, "nilio: odometry" first; that of the IMU only if there is one. The level is
/// the worst of the rows; the message is that row's value and remedy. `now`: CLOCK_REALTIME.
DiagnosticArray make_diagnostics(const DiagnosticInput& input, core::Time now);

/// The table as Markdown; docs/diagnostics.md is this text.
std::string diagnostic_reference();

}  // namespace nilio::dds
