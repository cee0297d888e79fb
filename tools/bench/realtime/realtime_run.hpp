#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/time.hpp"

#include "ipc/histogram.hpp"
#include "tools/bench/common/sensor_drive.hpp"
#include "tools/bench/odometry/run_figures.hpp"
#include "tools/bench/realtime/thread_watch.hpp"
#include "tools/common/stop_signals.hpp"
#include "tools/play/session.hpp"

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace nilio::tools {

/// What else the computer has to do during a run.
enum class Condition : std::uint8_t {
  kIdle,
  kHogs,            ///< two processes that never sleep
  kMemory,          ///< a process that takes most of the memory, again and again
  kSlowSubscriber,  ///< a DDS subscriber that has found the publisher and then reads nothing
};
/// "idle", "hogs", "memory", "subscriber".
const char* condition_name(Condition condition);
std::optional<Condition> parse_condition(const std::string& name);

/// How a drive gets into niliod at its own pace.
enum class Feed : std::uint8_t {
  kUdp,     ///< sent to its socket as the sensor does
  kReplay,  ///< niliod --replay --as-live
};

/// niliod with its publisher, at the sensor's pace.
struct RealtimeRunConfig {
  Feed feed = Feed::kUdp;
  Condition condition = Condition::kIdle;
  std::vector<std::string> overrides;
  /// Bound of kMemory.
  std::uint64_t memory_bytes = 0;
  /// Puts the CAN log on this interface, and niliod reads it there; empty = no IMU over kUdp.
  std::string can_interface;
  std::uint32_t domain = 0;
  /// UDP port to send to; 0 = one that is free.
  std::uint16_t port = 0;
};

struct RealtimeRun {
  RunFigures figures;
  /// kUdp only.
  std::optional<PlayReport> sent;
  /// To be added to kUdp's stamps, which are of the present, for those of the recording.
  core::Duration stamp_shift;
  ipc::LatencySummary noise;
  bool noise_is_fifo = false;
  /// DDS write to subscriber.
  ipc::LatencySummary transport;
  /// Last packet received to subscriber.
  ipc::LatencySummary packet_to_subscriber;
  /// Rows of the publisher's last report: last packet, or CAN frame of the IMU, to the return of DDS write().
  std::optional<ipc::LatencySummary> received_to_written;
  std::optional<ipc::LatencySummary> imu_pose;
  /// Calls of niliod's real-time threads, or why nobody watched them.
  std::optional<ThreadWatch> watch;
  std::string why_not_watched;
  /// What did not go as it was wanted; one line each.
  std::vector<std::string> notes;
};

core::Result<RealtimeRun> run_niliod_in_real_time(const SensorDrive& drive, const DrivePart& part,
                                                  const RealtimeRunConfig& config,
                                                  const std::filesystem::path& folder, StopSignals& signals);

}  // namespace nilio::tools
