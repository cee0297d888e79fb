#pragma once

#include "daemon/realtime/thread_hook.hpp"

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>

namespace nilio::tests {

/// What a real-time thread must not do, as far as a function of the C library or of C++ is called for it.
enum class Offence : std::uint8_t {
  kAllocation,  ///< malloc and its kin; operator new comes there, too
  kRelease,     ///< free
  kMapping,     ///< mmap, munmap, mprotect, madvise
  kLock,        ///< a mutex, a read-write lock, a condition variable or a semaphore of pthreads
  kThrow,       ///< an exception
  kOutput,      ///< written to standard output or error, through streams or by write()
  kCount
};
const char* name_of(Offence offence);

using OffenceCounts = std::array<std::uint64_t, static_cast<std::size_t>(Offence::kCount)>;

/// Counts offences of the real-time threads: of those that said so with daemon::ThreadHook, and of the
/// threads that they started (the workers of the odometry's arena). The functions themselves are replaced by
/// this library's; they count, and then do what they always do.
namespace watch {

/// For PipelineOptions::thread_hook.
void hook(daemon::ThreadRole role, daemon::ThreadPhase phase);
/// From now on, or no longer, calls count. From any thread.
void arm(bool armed);
/// Forgets what was counted.
void reset();

/// Calls from this project's code, directly or through a library.
OffenceCounts counts(daemon::ThreadRole role);
/// Calls that TBB makes for itself when it hands out tasks: its pools are not ours to fill.
OffenceCounts tbb_counts();
std::uint64_t total(const OffenceCounts& counts);
/// Threads that said of themselves that they are of this role.
std::size_t threads_seen(daemon::ThreadRole role);
/// Threads started by the odometry thread.
std::size_t workers_seen();
/// Where the first of them came from, a call stack each of so many frames; empty when there were none.
std::string report(int frames = 16);

}  // namespace watch

}  // namespace nilio::tests
