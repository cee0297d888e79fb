#pragma once

#include "daemon/realtime/thread_hook.hpp"

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>

namespace nilio::tests {

/// Operations forbidden in a real-time thread, as far as they are calls of C or C++ library functions.
enum class Offence : std::uint8_t {
  kAllocation,  ///< malloc and similar functions; includes operator new
  kRelease,     ///< free
  kMapping,     ///< mmap, munmap, mprotect, madvise
  kLock,        ///< a mutex, a read-write lock, a condition variable or a semaphore of pthreads
  kThrow,       ///< an exception
  kOutput,      ///< written to standard output or error, through streams or by write()
  kCount
};
const char* name_of(Offence offence);

using OffenceCounts = std::array<std::uint64_t, static_cast<std::size_t>(Offence::kCount)>;

/// Counts offences of the real-time threads: those that registered with daemon::ThreadHook, and the threads
/// they started (workers of the odometry's arena). Functions of this library replace the original ones; they
/// count and then call the original.
namespace watch {

/// For PipelineOptions::thread_hook.
void hook(daemon::ThreadRole role, daemon::ThreadPhase phase);
/// Starts or stops counting. Any thread.
void arm(bool armed);
/// Resets all counts.
void reset();

/// Calls from this project's code, direct or through a library.
OffenceCounts counts(daemon::ThreadRole role);
/// Calls of TBB's own task scheduling, whose pools are outside of this project's control.
OffenceCounts tbb_counts();
std::uint64_t total(const OffenceCounts& counts);
/// Threads registered with this role.
std::size_t threads_seen(daemon::ThreadRole role);
/// Threads started by the odometry thread.
std::size_t workers_seen();
/// Call stacks of the first offences with so many frames each; empty if there were none.
std::string report(int frames = 16);

}  // namespace watch

/// Interface between the replaced functions and the watch.
namespace interpose {

/// Counts the offence if the calling thread is watched.
void called(Offence offence);
/// Role of the calling thread, inherited by the threads it starts; -1 if it is not watched.
int role_to_inherit();
/// First call in a thread started by a watched thread.
void begin_worker(int role);

}  // namespace interpose

}  // namespace nilio::tests
