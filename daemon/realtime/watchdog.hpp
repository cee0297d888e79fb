#pragma once

#include "nilio/core/time.hpp"

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace nilio::daemon {

/// Finds threads that hang: a running thread has to advance its heartbeat within kLimit. Has no clock of its
/// own, and a caller that was not scheduled for long blames nobody. One thread.
class Watchdog {
 public:
  static constexpr core::Duration kLimit = core::Duration::from_seconds(1.0);

  struct Event {
    bool hangs = false;  ///< false: makes progress again
    std::string text;
  };
  /// Count of a thread's rounds; empty while it does not run.
  using Heartbeat = std::function<std::optional<std::uint64_t>()>;

  void watch(std::string name, Heartbeat heartbeat);
  /// New events. `now_ns`: CLOCK_MONOTONIC. Call several times per kLimit.
  std::vector<Event> poll(std::int64_t now_ns);
  /// Names of the threads that hang now.
  [[nodiscard]] std::vector<std::string> hanging() const;
  /// Number of hangs found.
  [[nodiscard]] std::uint64_t hangs() const { return hangs_; }

 private:
  struct Watched {
    std::string name;
    Heartbeat heartbeat;
    std::optional<std::uint64_t> count;
    std::int64_t progress_ns = 0;
    bool hangs = false;
  };

  std::vector<Watched> threads_;
  std::uint64_t hangs_ = 0;
};

}  // namespace nilio::daemon
