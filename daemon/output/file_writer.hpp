#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/time.hpp"

#include "daemon/odometry/pipeline.hpp"
#include "daemon/output/run_output.hpp"
#include "daemon/output/run_recorder.hpp"
#include "ipc/records.hpp"

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

namespace nilio::daemon {

/// Thread that writes the files of a run. All other threads only fill its rings: a slow or full disk costs
/// files, never poses. Data reach the kernel within kFlushPeriod, so that a killed
/// process loses no more. Used by the supervisor's thread.
class FileWriter {
 public:
  static constexpr core::Duration kFlushPeriod = core::Duration::from_milliseconds(200.0);

  struct Counters {
    std::uint64_t poses_dropped = 0;
    std::uint64_t decisions_dropped = 0;
    std::uint64_t clouds_dropped = 0;
    std::uint64_t packets_dropped = 0;
    std::uint64_t frames_dropped = 0;
    std::uint64_t disk_lost = 0;  ///< records taken, but not accepted by the disk in time
  };

  /// Starts the thread; `output` and `recorder` may be null. It takes the pipeline's decisions, clouds and
  /// recorded data.
  FileWriter(std::shared_ptr<Pipeline> pipeline, std::unique_ptr<RunOutput> output,
             std::unique_ptr<RunRecorder> recorder);
  /// Waits for the thread, unless finish() gave it up.
  ~FileWriter();
  FileWriter(const FileWriter&) = delete;
  FileWriter& operator=(const FileWriter&) = delete;

  /// False if the ring is full; the pose is then counted as dropped by add().
  [[nodiscard]] bool has_room() const;
  void add(const ipc::PoseRecord& record);
  /// A line about a disk that takes no data, or that takes them again; each once.
  std::optional<std::string> poll(std::int64_t now_ns);
  /// The disk takes no data, by the last poll().
  [[nodiscard]] bool is_slow() const { return slow_since_ns_ != 0; }
  /// Call after the pipeline ended: writes everything that waits and the final files. If the disk does not
  /// take them within `patience`, the thread is given up for the process to end, and the error says so.
  core::Result<std::monostate> finish(RunOutput::FinalFiles final_files, core::Duration patience);
  [[nodiscard]] Counters counters() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
  std::int64_t slow_since_ns_ = 0;
};

}  // namespace nilio::daemon
