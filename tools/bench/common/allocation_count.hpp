#pragma once

#include <cstdint>

namespace nilio::tools {

/// Calls of operator new by the calling thread since it began. Whatever links this function has its operator
/// new counted; with a sanitizer, which has its own, the count stays 0.
std::int64_t allocation_count();

/// False where a sanitizer's operator new is in use.
bool allocations_are_counted();

}  // namespace nilio::tools
