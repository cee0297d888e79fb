#include "tools/common/system.hpp"

#include "nilio/core/clock.hpp"

#include <algorithm>
#include <arpa/inet.h>
#include <cerrno>
#include <cstring>
#include <ctime>
#include <netinet/in.h>
#include <pthread.h>
#include <sched.h>
#include <string>
#include <sys/socket.h>
#include <unistd.h>

namespace nilio::tools {

namespace {

using core::Error;
using core::Result;

/// Socket that holds a port while the next one is probed.
class PortProbe {
 public:
  PortProbe() : socket_(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {}
  PortProbe(const PortProbe&) = delete;
  PortProbe& operator=(const PortProbe&) = delete;
  ~PortProbe() { close(socket_); }

  Result<std::uint16_t> bind_to(std::uint16_t port) const {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(port);
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t length = sizeof(address);
    auto* const generic = reinterpret_cast<sockaddr*>(&address);
    if (bind(socket_, generic, sizeof(address)) != 0 || getsockname(socket_, generic, &length) != 0)
      return Error{"UDP port " + std::to_string(port) + " of 127.0.0.1: not available (" +
                   std::strerror(errno) + ") - choose another --port, or leave it out for any"};
    return ntohs(address.sin_port);
  }

 private:
  int socket_;
};

}  // namespace

StopSignals::StopSignals() {
  sigemptyset(&signals_);
  for (const int signal : {SIGINT, SIGTERM}) sigaddset(&signals_, signal);
  // nohup ignores SIGHUP; keep it so.
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
  const timespec limit = to_timespec(timeout);
  stopped_ = sigtimedwait(&signals_, nullptr, &limit) > 0;
  return stopped_;
}

bool make_this_thread_fifo(int priority) {
  sched_param parameters{};
  parameters.sched_priority = priority;
  return pthread_setschedparam(pthread_self(), SCHED_FIFO, &parameters) == 0;
}

void sleep_until(std::int64_t until_ns) {
  const timespec until = to_timespec({until_ns});
  clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr);
}

Result<std::array<std::uint16_t, 2>> free_udp_ports(std::uint16_t first) {
  const PortProbe data;
  const PortProbe position;
  const Result<std::uint16_t> data_port = data.bind_to(first);
  if (!data_port) return data_port.error();
  const Result<std::uint16_t> position_port =
      position.bind_to(first == 0 ? std::uint16_t{0} : static_cast<std::uint16_t>(first + 1));
  if (!position_port) return position_port.error();
  return std::array{*data_port, *position_port};
}

}  // namespace nilio::tools
