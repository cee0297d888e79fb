#pragma once

#include <cstdint>
#include <optional>
#include <sys/types.h>

namespace nilio::tools {

/// Gives what the heap has free back to the kernel and starts the measurement of peak_resident() again.
/// Returns the resident memory now, bytes; 0 where the kernel does not tell.
std::uint64_t reset_peak_resident();

/// Largest resident memory of this process since reset_peak_resident(), bytes; 0 where the kernel does not
/// tell.
std::uint64_t peak_resident();

/// Bytes of a process that are in memory.
struct ResidentMemory {
  std::uint64_t total = 0;
  /// What it allocated itself: without programs, libraries and files.
  std::uint64_t anonymous = 0;
};

/// Counted page by page: the sums in /proc/PID/status are inaccurate (proc(5)). Nothing for a process
/// that has ended or is another user's.
std::optional<ResidentMemory> resident_memory(pid_t process);

/// Memory of the computer that is free or can be made so, bytes; 0 where the kernel does not tell.
std::uint64_t available_memory();

}  // namespace nilio::tools
