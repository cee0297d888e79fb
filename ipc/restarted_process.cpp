#include "ipc/restarted_process.hpp"

#include <algorithm>
#include <csignal>
#include <cstring>
#include <sys/resource.h>
#include <sys/wait.h>
#include <thread>
#include <utility>

namespace nilio::ipc {

RestartedProcess::RestartedProcess(std::string name, core::Duration start_interval, Spawn spawn)
    : name_(std::move(name)),
      start_interval_(std::chrono::nanoseconds(start_interval.ns)),
      spawn_(std::move(spawn)) {}

RestartedProcess::~RestartedProcess() {
  if (!running()) return;
  kill(pid_, SIGKILL);
  waitpid(pid_, nullptr, 0);
}

core::Result<pid_t> RestartedProcess::spawn(bool again) {
  last_start_ = Clock::now();
  auto started = spawn_(again);
  if (started) pid_ = *started;
  return started;
}

core::Result<pid_t> RestartedProcess::start() {
  if (running()) return pid_;
  wanted_ = true;
  return spawn(false);
}

core::Result<pid_t> RestartedProcess::restart() {
  if (running()) return pid_;
  ++restarts_;
  return spawn(true);
}

std::optional<ProcessEvent> RestartedProcess::poll() {
  if (running()) {
    int wait_status = 0;
    const pid_t waited = waitpid(pid_, &wait_status, WNOHANG);
    if (waited == 0) return std::nullopt;
    if (waited < 0) wait_status = 0;  // reaped by other code: exit status unknown
    ProcessEvent died = ended(ProcessEvent::Kind::kDied, wait_status);
    announce_restart(died);
    return died;
  }
  if (!wanted_ || Clock::now() < last_start_ + start_interval_) return std::nullopt;
  if (const auto started = restart(); !started) {
    ProcessEvent failed = event(ProcessEvent::Kind::kStartFailed);
    failed.message = started.error().message;
    announce_restart(failed);
    return failed;
  }
  ProcessEvent started = event(ProcessEvent::Kind::kStarted);
  started.message = name_ + " started again as process " + std::to_string(pid_) + " (restart " +
                    std::to_string(restarts_) + ")";
  return started;
}

ProcessEvent RestartedProcess::kill_hung(const std::string& reason) {
  kill(pid_, SIGKILL);
  ProcessEvent hung = event(ProcessEvent::Kind::kHung);
  hung.message = name_ + " " + std::to_string(pid_) + " " + reason + ": killing it";
  return hung;
}

void RestartedProcess::request_stop() {
  wanted_ = false;
  if (running()) kill(pid_, SIGTERM);
}

void RestartedProcess::hasten() const {
  // A child has its own process group.
  if (running()) setpriority(PRIO_PGRP, static_cast<id_t>(pid_), kHastyNice);
}

std::optional<ProcessEvent> RestartedProcess::stop(core::Duration timeout,
                                                   const std::function<bool()>& hangs) {
  request_stop();
  if (!running()) return std::nullopt;
  return wait(timeout, hangs);
}

ProcessEvent RestartedProcess::wait(core::Duration timeout, const std::function<bool()>& hangs) {
  const auto deadline = Clock::now() + std::chrono::nanoseconds(timeout.ns);
  int wait_status = 0;
  pid_t waited = waitpid(pid_, &wait_status, WNOHANG);
  while (waited == 0 && Clock::now() < deadline && !(hangs && hangs())) {
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
    waited = waitpid(pid_, &wait_status, WNOHANG);
  }
  if (waited == 0) {
    kill(pid_, SIGKILL);
    waitpid(pid_, &wait_status, 0);
  }
  return ended(ProcessEvent::Kind::kStopped, wait_status);
}

ProcessEvent RestartedProcess::event(ProcessEvent::Kind kind) const {
  ProcessEvent event;
  event.kind = kind;
  event.pid = pid_;
  event.restarts = restarts_;
  return event;
}

ProcessEvent RestartedProcess::ended(ProcessEvent::Kind kind, int wait_status) {
  ProcessEvent end = event(kind);
  end.message = name_ + " " + std::to_string(pid_);
  if (WIFSIGNALED(wait_status)) {
    end.signal = WTERMSIG(wait_status);
    end.message += " was killed by signal " + std::to_string(end.signal) + " (" + strsignal(end.signal) + ")";
  } else {
    end.exit_status = WEXITSTATUS(wait_status);
    end.message += " ended with status " + std::to_string(end.exit_status);
  }
  pid_ = -1;
  return end;
}

void RestartedProcess::announce_restart(ProcessEvent& event) const {
  const auto pause = std::max(last_start_ + start_interval_ - Clock::now(), Clock::duration::zero());
  event.pause = core::Duration{std::chrono::nanoseconds(pause).count()};
  event.message += event.pause.ns == 0
                       ? std::string(", next start now")
                       : ", next start in " + std::to_string(event.pause.ns / 1'000'000) + " ms";
}

}  // namespace nilio::ipc
