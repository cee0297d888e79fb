#include "stop_signals.hpp"

#include <algorithm>
#include <ctime>

namespace nilio::tools {

StopSignals::StopSignals() {
  sigemptyset(&signals_);
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) sigaddset(&signals_, signal);
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
