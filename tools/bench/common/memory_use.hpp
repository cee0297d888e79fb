#pragma once

#include <cstdint>
#include <optional>
#include <sys/types.h>

namespace nilio::tools::bench {

/// Calls of operator new by the calling thread so far. Programs that link this function count in their
/// operator new; under a sanitizer, which has its own, the count stays 0.
std::int64_t allocation_count();

/// False where a sanitizer's operator new is in use.
bool allocations_are_counted();

/// Returns free heap memory to the kernel and resets peak_resident(). Returns the resident memory now, bytes;
/// 0 where the kernel does not report it.
std::uint64_t reset_peak_resident();

/// Maximum resident memory of this process since reset_peak_resident(), bytes; 0 where the kernel does not
/// report it.
std::uint64_t peak_resident();

/// Resident memory of a process, bytes.
struct ResidentMemory {
  std::uint64_t total = 0;
  std::uint64_t anonymous = 0;  ///< allocated by the process: without programs, libraries and files
};

/// Exact to the page, unlike /proc/PID/status (proc(5)). Empty for a process that has ended or belongs to
/// another user.
std::optional<ResidentMemory> resident_memory(pid_t process);

/// Memory of the computer that is free or can be freed, bytes; 0 where the kernel does not report it.
std::uint64_t available_memory();

}  // namespace nilio::tools::bench
