#include "daemon/realtime/watchdog.hpp"

#include <array>
#include <cstdio>
#include <utility>

namespace nilio::daemon {

namespace {

std::string line(const char* format, const std::string& name, std::int64_t ns) {
  std::array<char, 200> text{};
  std::snprintf(text.data(), text.size(), format, name.c_str(), static_cast<double>(ns) * 1e-9);
  return text.data();
}

}  // namespace

void Watchdog::watch(std::string name, Heartbeat heartbeat) {
  threads_.push_back({std::move(name), std::move(heartbeat), std::nullopt, 0, false});
}

std::vector<Watchdog::Event> Watchdog::poll(std::int64_t now_ns) {
  std::vector<Event> events;
  for (Watched& thread : threads_) {
    const std::optional<std::uint64_t> count = thread.heartbeat();
    const bool progress = !count || count != thread.count;
    const std::int64_t without_ns = now_ns - thread.progress_ns;
    if (progress) {
      if (std::exchange(thread.hangs, false))
        events.push_back({false, line("%s: makes progress again after %.1f s", thread.name, without_ns)});
      thread.count = count;
      thread.progress_ns = now_ns;
    } else if (without_ns > kLimit.ns && !thread.hangs) {
      thread.hangs = true;
      ++hangs_;
      events.push_back({true, line("%s: hangs, no progress for %.1f s - see its stack with 'gdb -p', and "
                                   "restart niliod if it does not recover",
                                   thread.name, without_ns)});
    }
  }
  return events;
}

std::vector<std::string> Watchdog::hanging() const {
  std::vector<std::string> names;
  for (const Watched& thread : threads_) {
    if (thread.hangs) names.push_back(thread.name);
  }
  return names;
}

}  // namespace nilio::daemon
