#include "tests/realtime/watch.hpp"

#include <algorithm>
#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <cxxabi.h>
#include <dlfcn.h>
#include <execinfo.h>
#include <memory>

namespace nilio::tests {

namespace {

using daemon::ThreadPhase;
using daemon::ThreadRole;

constexpr std::size_t kRoles = daemon::kThreadRoles;
constexpr int kDepth = 40;
constexpr std::size_t kStacks = 12;
constexpr auto kOffences = static_cast<std::size_t>(Offence::kCount);

struct Stack {
  Offence offence = Offence::kAllocation;
  ThreadRole role = ThreadRole::kOdometry;
  int depth = 0;
  std::array<void*, kDepth> frames{};
};

struct ThreadMark {
  int role = -1;
  bool is_worker = false;
  bool was_seen = false;
  /// The watch itself allocates and locks.
  bool is_noting = false;
};
thread_local ThreadMark mark;

using Counters = std::array<std::atomic<std::uint64_t>, kOffences>;
std::atomic<bool> is_armed{false};
std::array<Counters, kRoles> of_role{};
Counters of_tbb{};
std::array<Stack, kStacks> stacks;
std::atomic<std::size_t> stack_count{0};
std::atomic<std::size_t> workers{0};
std::array<std::atomic<std::size_t>, kRoles> threads{};

bool is_in(const char* object, const char* library) {
  return object != nullptr && std::strstr(object, library) != nullptr;
}

/// Address range of this library.
const void* own_base() {
  static const void* const base = [] {
    Dl_info info{};
    dladdr(reinterpret_cast<const void*>(&own_base), &info);
    return info.dli_fbase;
  }();
  return base;
}

/// True if TBB itself made the call rather than a task: decided by the innermost frame outside of the C and
/// C++ libraries and the watch.
bool is_of_tbb(const Stack& stack) {
  for (int i = 0; i < stack.depth; ++i) {
    Dl_info info{};
    if (dladdr(stack.frames[static_cast<std::size_t>(i)], &info) == 0) return false;
    if (info.dli_fbase == own_base() || is_in(info.dli_fname, "libc.so") ||
        is_in(info.dli_fname, "libstdc++"))
      continue;
    return is_in(info.dli_fname, "libtbb");
  }
  return false;
}

OffenceCounts read(const Counters& counters) {
  OffenceCounts counts{};
  for (std::size_t i = 0; i < kOffences; ++i) counts[i] = counters[i].load();
  return counts;
}

std::string describe(void* frame) {
  Dl_info info{};
  if (dladdr(frame, &info) == 0) return "?";
  if (info.dli_sname == nullptr) {
    // Format of addr2line.
    std::array<char, 32> offset{};
    std::snprintf(offset.data(), offset.size(), " 0x%zx",
                  static_cast<std::size_t>(static_cast<char*>(frame) - static_cast<char*>(info.dli_fbase)));
    return info.dli_fname + std::string(offset.data());
  }
  int status = 0;
  const std::unique_ptr<char, void (*)(void*)> name(
      abi::__cxa_demangle(info.dli_sname, nullptr, nullptr, &status), std::free);
  return std::string(status == 0 ? name.get() : info.dli_sname).substr(0, 120);
}

void note(Offence offence) {
  Stack stack;
  stack.offence = offence;
  stack.role = static_cast<ThreadRole>(mark.role);
  stack.depth = backtrace(stack.frames.data(), kDepth);
  const auto index = static_cast<std::size_t>(offence);
  if (is_of_tbb(stack)) {
    ++of_tbb[index];
    return;
  }
  ++of_role[static_cast<std::size_t>(mark.role)][index];
  const std::size_t slot = stack_count.fetch_add(1);
  if (slot < kStacks) stacks[slot] = stack;
}

}  // namespace

const char* name_of(Offence offence) {
  constexpr std::array<const char*, kOffences> kNames{"allocation", "release", "mapping",
                                                      "lock",       "throw",   "output"};
  return kNames[static_cast<std::size_t>(offence)];
}

void interpose::called(Offence offence) {
  if (mark.role < 0 || mark.is_noting || !is_armed.load(std::memory_order_relaxed)) return;
  mark.is_noting = true;
  note(offence);
  mark.is_noting = false;
}

int interpose::role_to_inherit() { return mark.role; }

void interpose::begin_worker(int role) {
  mark.role = role;
  mark.is_worker = true;
  ++workers;
}

void watch::hook(ThreadRole role, ThreadPhase phase) {
  if (phase == ThreadPhase::kStarted) {
    mark.role = static_cast<int>(role);
    ++threads[static_cast<std::size_t>(role)];
  } else if (phase == ThreadPhase::kEnding) {
    mark.role = -1;
  }
}

void watch::arm(bool armed) {
  // Loads the unwinder.
  std::array<void*, 4> frames{};
  backtrace(frames.data(), 4);
  own_base();
  is_armed.store(armed);
}

void watch::reset() {
  for (Counters& counters : of_role) {
    for (auto& counter : counters) counter.store(0);
  }
  for (auto& counter : of_tbb) counter.store(0);
  stack_count.store(0);
  workers.store(0);
  for (auto& count : threads) count.store(0);
}

OffenceCounts watch::counts(ThreadRole role) { return read(of_role[static_cast<std::size_t>(role)]); }
OffenceCounts watch::tbb_counts() { return read(of_tbb); }
std::size_t watch::threads_seen(ThreadRole role) { return threads[static_cast<std::size_t>(role)].load(); }
std::size_t watch::workers_seen() { return workers.load(); }

std::uint64_t watch::total(const OffenceCounts& counts) {
  std::uint64_t sum = 0;
  for (const std::uint64_t count : counts) sum += count;
  return sum;
}

std::string watch::report(int frames) {
  std::string text;
  for (std::size_t i = 0; i < std::min(stack_count.load(), kStacks); ++i) {
    const Stack& stack = stacks[i];
    text += std::string(name_of(stack.offence)) + " in " + daemon::name_of(stack.role) + ":\n";
    for (int f = 2; f < std::min(stack.depth, frames); ++f)
      text += "    " + describe(stack.frames[static_cast<std::size_t>(f)]) + "\n";
  }
  return text;
}

}  // namespace nilio::tests
