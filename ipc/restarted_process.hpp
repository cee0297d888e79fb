#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/time.hpp"

#include <chrono>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <sys/types.h>

namespace nilio::ipc {

struct ProcessEvent {
  enum class Kind : std::uint8_t {
    kStarted,      ///< restarted after an exit
    kStartFailed,  ///< start failed; repeated after `pause`
    kDied,         ///< exited or was killed; restarted after `pause`
    kHung,         ///< killed because it makes no progress; kDied follows
    kStopped       ///< ended after stop()
  };
  Kind kind = Kind::kDied;
  pid_t pid = -1;
  int exit_status = -1;  ///< of a process that exited, else -1
  int signal = 0;        ///< signal that killed it, else 0
  std::uint64_t restarts = 0;
  core::Duration pause{0};
  std::string message;  ///< one line for the log
};

/// Nice value of what has to end in time on a computer whose CPU others take.
inline constexpr int kHastyNice = -20;

/// A child process that is restarted whenever it ends: at once if it ran for `start_interval`, otherwise
/// `start_interval` after its previous start. The outage is never longer than that, and a process that ends
/// at once costs one start per interval. One thread, which must live as long as the process: the kernel ends
/// a child together with the thread that started it. Only a start touches a file.
class RestartedProcess {
 public:
  /// Starts the program and returns its id. `again`: not the first start.
  using Spawn = std::function<core::Result<pid_t>(bool again)>;

  RestartedProcess(std::string name, core::Duration start_interval, Spawn spawn);
  /// Kills the process unless stop() was called.
  ~RestartedProcess();
  RestartedProcess(const RestartedProcess&) = delete;
  RestartedProcess& operator=(const RestartedProcess&) = delete;

  /// Starts the process and returns its id. On failure poll() tries again, unless stop() is called.
  core::Result<pid_t> start();
  /// Call about every 50 ms; does not block. At most one event per call.
  std::optional<ProcessEvent> poll();
  /// Kills the process because of `reason`; poll() then reports its end and restarts it.
  ProcessEvent kill_hung(const std::string& reason);
  /// Sends SIGTERM and does not wait; stop() follows.
  void request_stop();
  /// Gives its threads the CPU before those of others (nice -20), as far as this process may.
  void hasten() const;
  /// Starts the process again at once, for stop(), where it has died meanwhile.
  core::Result<pid_t> restart();
  /// Sends SIGTERM, and SIGKILL after `timeout`, or when `hangs` says so. Blocks for that time. Empty if it
  /// was not running.
  std::optional<ProcessEvent> stop(core::Duration timeout, const std::function<bool()>& hangs = nullptr);

  /// The same without SIGTERM, for a process that runs and ends by itself.
  ProcessEvent wait(core::Duration timeout, const std::function<bool()>& hangs = nullptr);

  [[nodiscard]] bool running() const { return pid_ > 0; }
  [[nodiscard]] pid_t pid() const { return pid_; }
  [[nodiscard]] std::uint64_t restarts() const { return restarts_; }

 private:
  using Clock = std::chrono::steady_clock;

  core::Result<pid_t> spawn(bool again);
  [[nodiscard]] ProcessEvent event(ProcessEvent::Kind kind) const;
  [[nodiscard]] ProcessEvent ended(ProcessEvent::Kind kind, int wait_status);
  void announce_restart(ProcessEvent& event) const;

  std::string name_;
  Clock::duration start_interval_;
  Spawn spawn_;
  pid_t pid_ = -1;
  bool wanted_ = false;
  std::uint64_t restarts_ = 0;
  Clock::time_point last_start_;
};

}  // namespace nilio::ipc
