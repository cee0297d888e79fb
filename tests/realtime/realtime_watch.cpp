#include "daemon/realtime/thread_plan.hpp"
#include "tests/realtime/watch.hpp"

#include <cstdio>
#include <cstdlib>
#include <functional>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <thread>

#include <catch2/catch.hpp>
#include <spdlog/spdlog.h>

using namespace nilio;
using daemon::ThreadPhase;
using daemon::ThreadRole;
using tests::Offence;
namespace watch = tests::watch;

namespace {

/// Number of offences detected in a watched thread.
tests::OffenceCounts caught(const std::function<void()>& deed) {
  watch::reset();
  std::thread thread([&] {
    watch::hook(ThreadRole::kOdometry, ThreadPhase::kStarted);
    watch::arm(true);
    deed();
    watch::arm(false);
    watch::hook(ThreadRole::kOdometry, ThreadPhase::kEnding);
  });
  thread.join();
  return watch::counts(ThreadRole::kOdometry);
}

std::uint64_t caught(Offence offence, const std::function<void()>& deed) {
  return caught(deed)[static_cast<std::size_t>(offence)];
}

volatile std::size_t sink = 0;

/// Prevents the compiler from removing the memory access.
void* keep(void* memory) {
  sink = reinterpret_cast<std::size_t>(memory);
  return reinterpret_cast<void*>(sink);
}

}  // namespace

TEST_CASE("a planted allocation in a watched thread is detected in every allocating function",
          "[realtime_watch][watch]") {
  CHECK(caught(Offence::kAllocation, [] {}) == 0);
  CHECK(caught(Offence::kAllocation, [] { keep(std::make_unique<int>(7).get()); }) == 1);
  CHECK(caught(Offence::kAllocation, [] { std::free(keep(std::malloc(100))); }) == 1);
  CHECK(caught(Offence::kAllocation, [] { std::free(keep(std::calloc(10, 10))); }) == 1);
  CHECK(caught(Offence::kAllocation, [] { std::free(keep(std::realloc(keep(std::malloc(10)), 5000))); }) ==
        2);
  CHECK(caught(Offence::kAllocation, [] { std::free(keep(std::aligned_alloc(64, 640))); }) == 1);
  CHECK(caught(Offence::kAllocation, [] {
          void* memory = nullptr;
          if (posix_memalign(&memory, 64, 640) == 0) std::free(keep(memory));
        }) == 1);
  CHECK(caught(Offence::kRelease, [] { std::free(keep(std::malloc(100))); }) == 1);
  CHECK(caught(Offence::kRelease, [] { std::free(nullptr); }) == 0);
}

TEST_CASE("a planted lock, exception or line of output in a watched thread is detected",
          "[realtime_watch][watch]") {
  std::mutex mutex;
  CHECK(caught(Offence::kLock, [&] { const std::lock_guard lock(mutex); }) == 1);
  CHECK(caught(Offence::kThrow, [] {
          try {
            throw std::runtime_error("planted");
          } catch (const std::exception& exception) {
            keep(const_cast<char*>(exception.what()));
          }
        }) == 1);
  CHECK(caught(Offence::kOutput, [] { std::fputs("planted\n", stdout); }) == 1);
  CHECK(watch::total(caught([] { spdlog::info("a line planted in a watched thread"); })) > 0);
}

TEST_CASE("threads started by a watched thread are watched, others are not", "[realtime_watch][watch]") {
  watch::reset();
  const auto counts = caught([] {
    std::thread worker([] { keep(std::make_unique<int>(7).get()); });
    worker.join();
  });
  CHECK(counts[static_cast<std::size_t>(Offence::kAllocation)] >= 1);
  CHECK(watch::workers_seen() == 1);
  watch::reset();
  watch::arm(true);
  keep(std::make_unique<int>(7).get());
  watch::arm(false);
  CHECK(watch::total(watch::counts(ThreadRole::kOdometry)) == 0);
}
