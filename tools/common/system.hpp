#pragma once

#include "nilio/core/clock.hpp"
#include "nilio/core/result.hpp"
#include "nilio/core/time.hpp"

#include <array>
#include <csignal>
#include <cstdint>

namespace nilio::tools {

/// Turns SIGINT, SIGTERM and (except under nohup) SIGHUP into a stop request, for commands that have work to
/// finish. Create it before other threads, so that they inherit the blocked signals. SIGPIPE and SIGXFSZ are
/// ignored: a closed terminal and a file at its size limit become errors of the system call.
class StopSignals {
 public:
  StopSignals();
  StopSignals(const StopSignals&) = delete;
  StopSignals& operator=(const StopSignals&) = delete;
  ~StopSignals();

  /// Waits up to `timeout`; true once a stop was requested. Only for the thread that created the object.
  bool wait(core::Duration timeout);

 private:
  sigset_t signals_{};
  sigset_t before_{};
  bool stopped_ = false;
};

/// Sets SCHED_FIFO for the calling thread; false where that is not permitted (it takes CAP_SYS_NICE or
/// RLIMIT_RTPRIO).
bool make_this_thread_fifo(int priority);

/// How often a tool looks at what it waits for.
inline constexpr core::Duration kPoll = core::Duration::from_milliseconds(20.0);

/// Sleeps until an absolute time of CLOCK_MONOTONIC, so that errors do not accumulate over several sleeps.
void sleep_until(std::int64_t until_ns);
inline void sleep_for(core::Duration duration) { sleep_until(monotonic_ns() + duration.ns); }

/// Two UDP ports of 127.0.0.1 without a receiver: `first` and the next one; any two for 0. Fails when a port
/// is in use.
core::Result<std::array<std::uint16_t, 2>> free_udp_ports(std::uint16_t first);

}  // namespace nilio::tools
