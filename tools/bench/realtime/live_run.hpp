#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/time.hpp"

#include "ipc/histogram.hpp"
#include "tools/bench/common/niliod_run.hpp"
#include "tools/bench/common/sensor_drive.hpp"
#include "tools/bench/realtime/pose_reader.hpp"
#include "tools/bench/realtime/thread_watch.hpp"
#include "tools/common/system.hpp"
#include "tools/play/session.hpp"

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace nilio::tools::bench {

/// Load of the computer during a run.
enum class Condition : std::uint8_t {
  kIdle,
  kCpuLoad,          ///< two processes that never sleep
  kMemory,           ///< a process that repeatedly takes most of the memory
  kSlowSubscriber,   ///< a DDS subscriber that is matched and then stops reading
  kUrgentLoad,       ///< two processes at nice -20 that never sleep, from before niliod's start
  kLaterUrgentLoad,  ///< the same from the first packet on
  kForeignSender,    ///< another sender of 20 valid packets a second to the same port
  kSlowDisk,         ///< every write to the output folder takes a second
  kFullDisk,         ///< the output folder's disk is full in the middle third of the run
};
inline constexpr std::size_t kConditions = 9;
/// "idle", "cpu", "memory", "subscriber", "nice", "nice-later", "foreign", "slow-disk", "full-disk".
const char* condition_name(Condition condition);
std::optional<Condition> parse_condition(const std::string& name);
/// Empty, or why this computer cannot have the condition.
std::string why_impossible(Condition condition);

/// Path of a drive into niliod, at the pace of the recording.
enum class Feed : std::uint8_t {
  kUdp,     ///< sent to niliod's socket
  kReplay,  ///< niliod --replay --as-live
};

/// Settings of a run of niliod and its publisher at the sensor's pace.
struct RealtimeRunConfig {
  Feed feed = Feed::kUdp;
  Condition condition = Condition::kIdle;
  std::vector<std::string> overrides;
  /// Maximum of kMemory.
  std::uint64_t memory_bytes = 0;
  /// Interface for the frames of the CAN log; empty = no IMU over kUdp.
  std::string can_interface;
  std::uint32_t domain = 0;
  /// UDP port to send to; 0 = any free one.
  std::uint16_t port = 0;
};

struct RealtimeRun {
  NiliodFigures figures;
  /// Only for kUdp.
  std::optional<play::PlayReport> sent;
  /// Difference of the recording's stamps to those of kUdp, which are the time of the run.
  core::Duration stamp_shift;
  ipc::LatencySummary wakeup;
  bool wakeup_is_fifo = false;
  /// From DDS write() to the subscriber.
  ipc::LatencySummary transport;
  /// From the last packet's reception to the subscriber.
  ipc::LatencySummary packet_to_subscriber;
  /// From the last packet's reception, or the IMU's CAN frame, to the return of DDS write(); from the
  /// publisher's last report.
  std::optional<ipc::LatencySummary> received_to_written;
  std::optional<ipc::LatencySummary> imu_pose;
  /// A reader of another vendor in a process of its own, or the reason why there was none.
  std::optional<ReaderFigures> reader;
  std::string why_no_reader;
  /// From SIGTERM to the end of niliod; only for kUdp.
  std::optional<double> stop_s;
  /// Forbidden calls, or the reason why they were not counted.
  std::optional<ThreadWatch> watch;
  std::string why_not_watched;
  /// Problems that did not end the run; one line each.
  std::vector<std::string> notes;
};

core::Result<RealtimeRun> run_niliod_in_real_time(const SensorDrive& drive, const DrivePart& part,
                                                  const RealtimeRunConfig& config,
                                                  const std::filesystem::path& folder, StopSignals& signals);

}  // namespace nilio::tools::bench
