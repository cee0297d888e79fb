#pragma once

#include <cstdint>

namespace nilio::tools {

/// Gives what the heap has free back to the kernel and starts the measurement of peak_resident() again.
/// Returns the resident memory now, bytes; 0 where the kernel does not tell.
std::uint64_t reset_peak_resident();

/// Largest resident memory of this process since reset_peak_resident(), bytes; 0 where the kernel does not
/// tell.
std::uint64_t peak_resident();

}  // namespace nilio::tools
