#include "daemon/realtime/startup_priority.hpp"

#include <sched.h>
#include <thread>

#include <catch2/catch.hpp>

using nilio::daemon::StartupPriority;

namespace {

int policy() { return sched_getscheduler(0) & ~SCHED_RESET_ON_FORK; }

}  // namespace

TEST_CASE("the start has FIFO priority, threads started meanwhile have not", "[startup_priority]") {
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
