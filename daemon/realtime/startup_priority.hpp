#pragma once

namespace nilio::daemon {

/// Runs the calling thread at the lowest FIFO priority during its lifetime, so that busy programs do not
/// delay the start, in which packets already arrive. Threads and processes started meanwhile have normal
/// scheduling. Without the permission nothing changes; the FIFO threads report that.
class StartupPriority {
 public:
  StartupPriority();
  StartupPriority(const StartupPriority&) = delete;
  StartupPriority& operator=(const StartupPriority&) = delete;
  ~StartupPriority();

 private:
  bool granted_ = false;
};

}  // namespace nilio::daemon
