#pragma once

#include <atomic>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "mapping/localisation/localiser.hpp"

namespace nilio::daemon {

struct LocalisationThreadConfig {
  std::filesystem::path map;  ///< folder of the saved map
  /// The map is of a run that was killed: it is completed first.
  bool continues_run = false;
  double range_m = 50.0;
  /// add() refuses keyframes without room, so that results do not depend on the computing time; else the
  /// oldest waiting ones are dropped.
  bool keeps_all = false;
};

/// Localisation in a saved map, in a thread of its own, so that loading and searching delay no submap. The
/// files of the map are opened for reading only, unless it has to be completed.
class LocalisationThread {
 public:
  explicit LocalisationThread(LocalisationThreadConfig config);
  LocalisationThread(const LocalisationThread&) = delete;
  LocalisationThread& operator=(const LocalisationThread&) = delete;
  /// Waits for the search that is under way.
  ~LocalisationThread();

  // Of one other thread.

  /// False: no room yet. None of these functions waits.
  [[nodiscard]] bool add(const mapping::Keyframe& keyframe);
  /// Results since the last call, in order.
  std::vector<mapping::Localisation> take();
  /// Whether all keyframes have a result, or none will get one.
  [[nodiscard]] bool is_done() const;
  /// The map is loaded, or cannot be used; once.
  struct Loaded {
    std::string message;
    bool ok = false;
  };
  std::optional<Loaded> take_loaded();
  [[nodiscard]] std::uint64_t dropped() const { return dropped_.load(); }

 private:
  void run();
  [[nodiscard]] std::optional<mapping::SavedMap> load();
  void recover() const;
  [[nodiscard]] bool ends() const;

  const LocalisationThreadConfig config_;
  std::atomic<std::uint64_t> dropped_{0};

  mutable std::mutex mutex_;  // of the following
  std::condition_variable changed_;
  std::deque<mapping::Keyframe> queue_;
  std::vector<mapping::Localisation> results_;
  std::optional<Loaded> loaded_;
  bool has_failed_ = false;
  bool ends_ = false;

  std::optional<core::SE3> last_pose_;  ///< of the thread
  std::thread thread_;
};

}  // namespace nilio::daemon
