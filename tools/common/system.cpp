#include "tools/common/stop_signals.hpp"

#include <algorithm>
#include <ctime>

namespace nilio::tools {

StopSignals::StopSignals() {
  sigemptyset(&signals_);
  for (const int signal : {SIGINT, SIGTERM}) sigaddset(&signals_, signal);
  // Under nohup the end of the terminal is to be ignored.
  struct sigaction hang_up {};
  if (sigaction(SIGHUP, nullptr, &hang_up) == 0 && hang_up.sa_handler != SIG_IGN)
    sigaddset(&signals_, SIGHUP);
  pthread_sigmask(SIG_BLOCK, &signals_, &before_);
  struct sigaction ignore {};
  ignore.sa_handler = SIG_IGN;
  sigaction(SIGPIPE, &ignore, nullptr);
  sigaction(SIGXFSZ, &ignore, nullptr);
}

StopSignals::~StopSignals() { pthread_sigmask(SIG_SETMASK, &before_, nullptr); }

bool StopSignals::wait(core::Duration timeout) {
  if (stopped_) return true;
  const std::int64_t ns = std::max<std::int64_t>(timeout.ns, 0);
  const timespec limit{ns / 1'000'000'000, ns % 1'000'000'000};
  stopped_ = sigtimedwait(&signals_, nullptr, &limit) > 0;
  return stopped_;
}

}  // namespace nilio::tools
