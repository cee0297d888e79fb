#include "daemon/realtime/thread_plan.hpp"

#include <sched.h>
#include <string>
#include <thread>

#include <catch2/catch.hpp>

using nilio::daemon::cpu_list_text;
using nilio::daemon::CpuList;
using nilio::daemon::parse_cpu_list;
using nilio::daemon::StartupPriority;

namespace {

int policy() { return sched_getscheduler(0) & ~SCHED_RESET_ON_FORK; }

}  // namespace

TEST_CASE("CPU lists have the format of taskset; an empty list means any", "[thread_plan]") {
  CHECK(parse_cpu_list("").value().empty());
  CHECK(parse_cpu_list("0").value() == CpuList{0});
  CHECK(parse_cpu_list("1-2,4").value() == CpuList{1, 2, 4});
  CHECK(parse_cpu_list("5,0-1,1").value() == CpuList{0, 1, 5});
  for (const std::string text : {"", "0", "1-2,4", "0-3,7,9-10,1023"}) {
    CAPTURE(text);
    CHECK(cpu_list_text(parse_cpu_list(text).value()) == text);
  }
}

TEST_CASE("an invalid CPU list is rejected with the wrong item", "[thread_plan]") {
  for (const std::string text :
       {"a", "1-", "-1", "3-1", "1024", "1,,2", "1,", ",", "1 ", "0x1", "99999999999"}) {
    CAPTURE(text);
    const auto cpus = parse_cpu_list(text);
    REQUIRE_FALSE(cpus.ok());
    CHECK(cpus.error().message.find("expected numbers and ranges") != std::string::npos);
  }
  CHECK(parse_cpu_list("0,7-x").error().message.find("'7-x'") != std::string::npos);
}

TEST_CASE("the start has FIFO priority, threads started meanwhile have not", "[thread_plan]") {
  // The flag stays with the thread, hence one of its own.
  std::thread([] {
    REQUIRE(policy() == SCHED_OTHER);
    {
      const StartupPriority priority;
      if (policy() == SCHED_OTHER) {
        WARN("skipped: no permission for FIFO threads");
        return;
      }
      CHECK(policy() == SCHED_FIFO);
      std::thread([] { CHECK(policy() == SCHED_OTHER); }).join();
    }
    CHECK(policy() == SCHED_OTHER);
  }).join();
}
