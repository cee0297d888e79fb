#include "ipc/restarted_process.hpp"

#include "ipc/child_process.hpp"
#include "tests/support/eventually.hpp"

#include <chrono>
#include <csignal>
#include <optional>
#include <spawn.h>
#include <string>
#include <sys/resource.h>
#include <unistd.h>
#include <vector>

#include <catch2/catch.hpp>

namespace {

using Catch::Matchers::Contains;
using nilio::core::Duration;
using nilio::ipc::ProcessEvent;
using nilio::ipc::RestartedProcess;
using nilio::tests::eventually;
using Clock = std::chrono::steady_clock;
using Kind = ProcessEvent::Kind;

RestartedProcess::Spawn shell(std::string script) {
  return [script](bool) -> nilio::core::Result<pid_t> {
    std::string name = "sh";
    std::string option = "-c";
    std::string text = script;
    char* const argv[] = {name.data(), option.data(), text.data(), nullptr};
    pid_t pid = -1;
    if (posix_spawn(&pid, "/bin/sh", nullptr, nullptr, argv, environ) != 0)
      return nilio::core::Error{"no shell"};
    return pid;
  };
}

ProcessEvent wait_for_event(RestartedProcess& process) {
  std::optional<ProcessEvent> event;
  REQUIRE(eventually([&] {
    event = process.poll();
    return event.has_value();
  }));
  return *event;
}

}  // namespace

TEST_CASE("a process that ran longer than the start interval is restarted at once", "[restarted_process]") {
  RestartedProcess process("program", Duration::from_milliseconds(50.0), shell("sleep 0.2; exit 3"));
  REQUIRE(process.start().ok());
  for (std::uint64_t restart = 0; restart < 2; ++restart) {
    const ProcessEvent died = wait_for_event(process);
    REQUIRE(died.kind == Kind::kDied);
    CHECK(died.exit_status == 3);
    CHECK(died.signal == 0);
    CHECK(died.restarts == restart);
    CHECK(died.pause.ns == 0);
    CHECK_THAT(died.message, Contains("program") && Contains("ended with status 3, next start now"));
    const auto started = process.poll();
    REQUIRE(started.has_value());
    CHECK(started->kind == Kind::kStarted);
    CHECK(started->restarts == restart + 1);
  }
}

TEST_CASE("a process that ends at once is started once per interval, however long that goes on",
          "[restarted_process]") {
  const Duration interval = Duration::from_milliseconds(100.0);
  RestartedProcess process("program", interval, shell("exit 1"));
  const auto begin = Clock::now();
  REQUIRE(process.start().ok());
  for (int starts = 1; starts < 8; ++starts) {
    const ProcessEvent died = wait_for_event(process);
    REQUIRE(died.kind == Kind::kDied);
    CHECK(died.pause <= interval);
    REQUIRE(wait_for_event(process).kind == Kind::kStarted);
    CHECK(Clock::now() - begin >= starts * std::chrono::milliseconds(100));
  }
  CHECK(process.restarts() == 7);
}

TEST_CASE("a start that fails is repeated after the interval", "[restarted_process]") {
  int attempts = 0;
  RestartedProcess process("program", Duration::from_milliseconds(10.0),
                           [&](bool again) -> nilio::core::Result<pid_t> {
                             CHECK(again == (attempts > 0));
                             if (++attempts < 3) return nilio::core::Error{"no such file"};
                             return shell("exec sleep 110")(again);
                           });
  CHECK_FALSE(process.start().ok());
  const ProcessEvent failed = wait_for_event(process);
  CHECK(failed.kind == Kind::kStartFailed);
  CHECK_THAT(failed.message, Contains("no such file, next start in "));
  CHECK(wait_for_event(process).kind == Kind::kStarted);
  CHECK(process.running());
}

TEST_CASE("a stopped process stays stopped", "[restarted_process]") {
  RestartedProcess process("program", Duration::from_milliseconds(10.0), shell("exec sleep 120"));
  REQUIRE(process.start().ok());
  const auto stopped = process.stop(Duration::from_seconds(10.0));
  REQUIRE(stopped.has_value());
  CHECK(stopped->kind == Kind::kStopped);
  CHECK(stopped->signal == SIGTERM);
  usleep(30'000);
  CHECK_FALSE(process.poll().has_value());
  CHECK_FALSE(process.stop(Duration{0}).has_value());
}

TEST_CASE("a process that has to end in time goes before others", "[restarted_process]") {
  RestartedProcess process("program", Duration::from_seconds(1.0), [](bool) {
    return nilio::ipc::spawn_child({"/bin/sleep", "10"}, {});
  });
  REQUIRE(process.start().ok());
  const auto id = static_cast<id_t>(process.pid());
  if (setpriority(PRIO_PROCESS, id, -1) != 0) {
    WARN("not tested: no privilege for negative nice values");
    return;
  }
  process.hasten();
  CHECK(getpriority(PRIO_PROCESS, id) == -20);
}

TEST_CASE("a stop ends early where the process hangs, and a process that is dead can be restarted for it",
          "[restarted_process]") {
  RestartedProcess process("program", Duration::from_seconds(100.0),
                           shell("trap '' TERM; while :; do sleep 1; done"));
  REQUIRE(process.start().ok());
  usleep(100'000);
  int asked = 0;
  const auto hung = process.stop(Duration::from_seconds(30.0), [&] { return ++asked > 3; });
  REQUIRE(hung.has_value());
  CHECK(hung->signal == SIGKILL);
  CHECK(asked == 4);
  REQUIRE(process.restart().ok());
  CHECK(process.restarts() == 1);
  CHECK(process.running());
  process.stop(Duration{0});
  CHECK_FALSE(process.poll().has_value());
}
