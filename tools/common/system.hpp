#pragma once

#include "nilio/core/time.hpp"

#include <csignal>

namespace nilio::tools {

/// Makes of SIGINT, SIGTERM and (except under nohup) SIGHUP a wish to stop, for commands that have something
/// to finish. Make it before other threads, which inherit what is blocked. A closed terminal and a file at
/// its size limit are then errors of the call that meets them instead of the end of the program.
class StopSignals {
 public:
  StopSignals();
  StopSignals(const StopSignals&) = delete;
  StopSignals& operator=(const StopSignals&) = delete;
  ~StopSignals();

  /// True when the wish has come, now or before; waits up to `timeout`. The thread that made it only.
  bool wait(core::Duration timeout);

 private:
  sigset_t signals_{};
  sigset_t before_{};
  bool stopped_ = false;
};

}  // namespace nilio::tools
