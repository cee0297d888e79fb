#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/time.hpp"

#include "ipc/overwriting_ring.hpp"
#include "ipc/restarted_process.hpp"
#include "ipc/scan_cloud.hpp"
#include "ipc/shared_object.hpp"
#include "ipc/wake_event.hpp"

#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <sys/types.h>
#include <variant>
#include <vector>

namespace nilio::ipc {

struct MapperProcessConfig {
  std::filesystem::path executable;  ///< nilio-mapper
  std::filesystem::path folder;      ///< of the map to write; empty: none
  std::filesystem::path saved_map;   ///< to localise in; empty: none
  bool continues_run = false;        ///< saved_map is of a run that was killed
  /// Results of localisation, one line for each keyframe; empty: none.
  std::filesystem::path localisation_file;
  bool keeps_all = false;  ///< an unpaced replay: localisation gets every keyframe
  double range_m = 50.0;   ///< points farther from the sensor are left out
  bool publish = true;     ///< over DDS
  std::uint32_t domain = 0;
  std::vector<std::string> interface_whitelist;
  std::string map_frame = "map";
  std::string odom_frame = "odom";
  std::string topic_prefix;
  int max_voxels = 200'000;  ///< of an open submap; three are open
  int kept_submaps = 20;     ///< submaps kept for late subscribers
  bool closes_loops = true;
  bool returns_submaps = false;  ///< through submaps()
  core::Duration start_interval = core::Duration::from_seconds(1.0);
  /// Killed if it reads no keyframe for this time while some wait; a disk may take long.
  core::Duration hang_timeout = core::Duration::from_seconds(30.0);
  /// Killed by stop() if it makes no progress for this time.
  core::Duration stop_hang_timeout = core::Duration::from_seconds(5.0);
};

/// Localisation in a saved map, as the mapper last reported it.
enum class MapperLocalisation : std::uint32_t { kOff, kLoading, kSearching, kLocalised, kOutside, kFailed };
/// Name in latency.json.
const char* name_of(MapperLocalisation state);

/// Counters of nilio-mapper, in shared memory; a restarted mapper continues them. One thread records, any
/// reads.
struct MapperState {
  std::atomic<std::uint64_t> heartbeat{0};
  std::atomic<std::uint64_t> keyframes{0};
  std::atomic<std::uint64_t> submaps{0};        ///< on disk
  std::atomic<std::uint64_t> map_bytes{0};      ///< of their files
  std::atomic<std::uint64_t> failed_writes{0};  ///< submaps or keyframes that the disk refused
  std::atomic<std::uint64_t> loops{0};          ///< accepted
  std::atomic<MapperLocalisation> localisation{MapperLocalisation::kOff};
  std::atomic<std::uint64_t> localised_keyframes{0};
  std::atomic<std::uint64_t> localisation_dropped{0};  ///< keyframes that localisation had no time for
  /// CLOCK_MONOTONIC at which a mapper that has been stopped is killed; 0: not stopped.
  std::atomic<std::int64_t> stop_deadline_ns{0};
};

/// Starts, supervises and restarts `nilio-mapper`, and owns the shared memory with it. The mapper may be
/// slow, hang or die: keyframes are overwritten, and counted.
///
/// push() and has_room() belong to the odometry thread, start(), poll(), request_stop() and stop() to one
/// supervising thread (see RestartedProcess), the other getters to any thread.
class MapperProcess {
 public:
  static core::Result<std::unique_ptr<MapperProcess>> create(MapperProcessConfig config);
  MapperProcess(const MapperProcess&) = delete;
  MapperProcess& operator=(const MapperProcess&) = delete;

  core::Result<pid_t> start() { return process_.start(); }
  /// Call about every 50 ms; does not block.
  std::optional<ProcessEvent> poll();
  /// Begins what stop() waits for; the process is told that it has `timeout` in all.
  void request_stop(core::Duration timeout);
  /// Lets the process read the waiting keyframes, complete the map and end. One that has died or hangs is
  /// started once more for that. Killed after `timeout`, which costs the submaps that were open their
  /// surfaces, not their keyframes. The events in order; none if the program cannot be started.
  std::vector<ProcessEvent> stop(core::Duration timeout);
  /// After stop(): writes trajectory_optimised.tum beside the trajectory of the run, by another process,
  /// which is killed after `timeout`. Blocks for that time.
  [[nodiscard]] core::Result<std::monostate> correct_trajectory(const std::filesystem::path& trajectory,
                                                                core::Duration timeout) const;
  /// The same for the map as a point cloud, of which `output` holds the first submaps if there is too little
  /// time.
  [[nodiscard]] core::Result<std::monostate> export_map(const std::filesystem::path& output,
                                                        core::Duration timeout) const;
  /// The same for trajectory_map.tum, the poses in the frame of the saved map.
  [[nodiscard]] core::Result<std::monostate> localise_trajectory(const std::filesystem::path& trajectory,
                                                                 core::Duration timeout) const;

  void push(const ScanCloud& keyframe) noexcept;
  /// False while push() would overwrite an unread keyframe.
  [[nodiscard]] bool has_room() const { return keyframes_.has_room(); }
  [[nodiscard]] const OverwritingRing<ScanCloud>& keyframes() const { return keyframes_; }
  /// Complete submaps for one consumer; null unless they are returned. A restarted mapper repeats the last
  /// one.
  [[nodiscard]] std::shared_ptr<OverwritingRing<SubmapCloud>> submaps() const { return submaps_; }
  [[nodiscard]] const MapperState& state() const { return *state_; }
  /// See RestartedProcess.
  void hasten() const { process_.hasten(); }
  [[nodiscard]] bool running() const { return process_.running(); }
  [[nodiscard]] pid_t pid() const { return process_.pid(); }
  [[nodiscard]] std::uint64_t restarts() const { return process_.restarts(); }
  [[nodiscard]] const std::filesystem::path& folder() const { return config_.folder; }

 private:
  using Clock = std::chrono::steady_clock;

  MapperProcess(MapperProcessConfig config, OverwritingRing<ScanCloud> keyframes, WakeEvent wake,
                SharedObject<MapperState> state, std::shared_ptr<OverwritingRing<SubmapCloud>> submaps);
  core::Result<pid_t> spawn(bool publish);
  [[nodiscard]] core::Result<std::monostate> run_once(std::vector<std::string> arguments,
                                                      core::Duration timeout) const;

  MapperProcessConfig config_;
  std::string session_;
  OverwritingRing<ScanCloud> keyframes_;
  WakeEvent wake_;
  SharedObject<MapperState> state_;
  std::shared_ptr<OverwritingRing<SubmapCloud>> submaps_;
  RestartedProcess process_;
  bool is_ending_ = false;
  std::uint64_t taken_ = 0;
  Clock::time_point progress_at_;
};

}  // namespace nilio::ipc
