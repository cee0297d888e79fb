// Watches an unmodified program, niliod with this library in LD_PRELOAD. NILIO_WATCH_REPORT=FILE writes the
// counts as JSON at the program's end. NILIO_WATCH_PLANT=1 makes the odometry thread allocate, release and
// lock once, which must be detected.
#include "nilio/core/clock.hpp"

#include "tests/realtime/watch.hpp"

#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <mutex>
#include <string>

namespace watch = nilio::tests::watch;
using nilio::daemon::kThreadRoles;
using nilio::daemon::ThreadPhase;
using nilio::daemon::ThreadRole;
using nilio::tests::OffenceCounts;

namespace {

std::atomic<std::int64_t> armed_ns{0};
std::atomic<std::int64_t> watched_ns{0};

/// Programs started by the watched one are not watched.
[[gnu::constructor]] void leave_children_alone() {
  if (std::getenv("NILIO_WATCH_REPORT") != nullptr) unsetenv("LD_PRELOAD");
}

void plant() {
  // Volatile pointer, so that the compiler cannot remove the allocation.
  void* volatile memory = std::malloc(1);
  std::free(memory);
  static std::mutex mutex;
  const std::lock_guard lock(mutex);
}

std::string to_json(const OffenceCounts& counts) {
  std::string text = "{";
  for (std::size_t i = 0; i < counts.size(); ++i) {
    const char* const name = nilio::tests::name_of(static_cast<nilio::tests::Offence>(i));
    text += (i == 0 ? "\"" : ", \"") + std::string(name) + "\": " + std::to_string(counts[i]);
  }
  return text + "}";
}

/// File and function names; only this character needs escaping.
std::string quoted(const std::string& text) {
  std::string result = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') result += '\\';
    result += c == '\n' ? std::string("\\n") : std::string(1, c);
  }
  return result + "\"";
}

[[gnu::destructor]] void write_report() {
  const char* const path = std::getenv("NILIO_WATCH_REPORT");
  if (path == nullptr || armed_ns.load() == 0) return;
  std::string text = "{\"watched_ns\": " + std::to_string(watched_ns.load()) + ",\n \"threads\": [";
  for (std::size_t i = 0; i < kThreadRoles; ++i) {
    const auto role = static_cast<ThreadRole>(i);
    text += (i == 0 ? "\n" : ",\n") + std::string("  {\"name\": \"") + name_of(role) +
            "\", \"seen\": " + std::to_string(watch::threads_seen(role)) +
            ", \"counts\": " + to_json(watch::counts(role)) + "}";
  }
  text += "],\n \"workers\": " + std::to_string(watch::workers_seen()) +
          ",\n \"tbb\": " + to_json(watch::tbb_counts()) + ",\n \"calls\": " + quoted(watch::report()) +
          "}\n";
  std::FILE* const file = std::fopen(path, "w");
  if (file == nullptr) return;
  std::fwrite(text.data(), 1, text.size(), file);
  std::fclose(file);
}

}  // namespace

/// See daemon::kPreloadedHook. Counting starts when the odometry is warm and ends with its last scan.
extern "C" void nilio_thread_hook(ThreadRole role, ThreadPhase phase) {
  watch::hook(role, phase);
  if (role != ThreadRole::kOdometry) return;
  if (phase == ThreadPhase::kWarm) {
    armed_ns.store(nilio::monotonic_ns());
    watch::arm(true);
    if (std::getenv("NILIO_WATCH_PLANT") != nullptr) plant();
  } else if (phase == ThreadPhase::kEnding && armed_ns.load() != 0) {
    watch::arm(false);
    watched_ns.store(nilio::monotonic_ns() - armed_ns.load());
  }
}
