#pragma once

#include <csignal>
#include <sys/prctl.h>
#include <sys/signalfd.h>
#include <unistd.h>

namespace nilio::daemon {

// The start of nilio-publisher and nilio-mapper, before any thread.

/// Blocks SIGTERM and SIGINT in this and all later threads and returns a signalfd for them; -1 on error, with
/// errno.
inline int take_signals() {
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGTERM);
  sigaddset(&signals, SIGINT);
  sigprocmask(SIG_BLOCK, &signals, nullptr);
  return signalfd(-1, &signals, SFD_CLOEXEC | SFD_NONBLOCK);
}

/// Lets this process end with its parent; 0 means that it has none to follow. Returns false if the parent has
/// already ended.
inline bool end_with_parent(pid_t parent) {
  if (parent == 0) return true;
  prctl(PR_SET_PDEATHSIG, SIGTERM);
  return getppid() == parent;
}

}  // namespace nilio::daemon
