#pragma once

#include "nilio/core/se3.hpp"

#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "mapping/loops/loop_closure.hpp"
#include "mapping/map_folder.hpp"

namespace nilio::daemon {

/// Corrected poses, which are on disk.
struct LoopUpdate {
  std::vector<std::pair<std::uint32_t, core::SE3>> poses;  ///< ids and T_map_submap
  core::SE3 T_map_odom;                                    ///< at the last submap
  std::size_t loops = 0;                                   ///< accepted ones
  /// Loops that are new or given up since the last update; empty: submaps were added.
  std::string cause;
};

/// Loop closure in a thread of its own, so that a search or a solution delays no keyframe. It reads each
/// complete submap back from disk, as `nilio map close` does, searches, and replaces the file `poses` of the
/// map. Loops that the file has already are taken from it. Waiting submaps cost the size of their entries.
class LoopThread {
 public:
  /// `writer`: of the map; outlives this, and may write submaps meanwhile.
  explicit LoopThread(const mapping::MapWriter& writer);
  LoopThread(const LoopThread&) = delete;
  LoopThread& operator=(const LoopThread&) = delete;
  /// Waits for the submap that is worked on.
  ~LoopThread();

  // Of one other thread; none waits for the work.

  void add(const mapping::SubmapEntry& entry);
  /// Searches the loops of the last submap, too.
  void finish();
  /// Whether the work up to finish() is on disk.
  [[nodiscard]] bool is_done() const;
  /// Submaps that wait.
  [[nodiscard]] std::size_t waiting() const;
  /// Newest update since the last call.
  std::optional<LoopUpdate> take();
  /// A file that could not be read or written since the last call.
  std::optional<std::string> take_failure();

 private:
  void run();
  void work(const mapping::SubmapEntry* entry);
  [[nodiscard]] std::optional<mapping::Submap> load(std::uint32_t id);
  void fail(const std::string& message);
  [[nodiscard]] std::string describe_change();

  // Of the thread.
  const mapping::MapWriter& writer_;
  /// Submap up to which an earlier process has worked, and its loops.
  const std::optional<std::uint32_t> last_known_;
  const std::vector<mapping::Loop> known_;
  std::vector<mapping::SubmapEntry> entries_;
  mapping::LoopCloser closer_;
  std::vector<std::pair<std::uint32_t, std::uint32_t>> accepted_;  ///< moving and reference submaps

  mutable std::mutex mutex_;  // of the following
  std::condition_variable changed_;
  std::deque<mapping::SubmapEntry> queue_;
  std::optional<LoopUpdate> update_;
  std::optional<std::string> failure_;
  bool finishes_ = false;
  bool is_done_ = false;
  bool ends_ = false;

  std::thread thread_;
};

}  // namespace nilio::daemon
