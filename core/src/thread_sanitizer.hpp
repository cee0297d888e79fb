#pragma once

// Debian's TBB is not instrumented, so ThreadSanitizer does not see the happens-before edges around parallel
// loops. These two calls annotate them; in other builds they compile to nothing.
#if defined(__SANITIZE_THREAD__)
extern "C" void __tsan_acquire(void* address);
extern "C" void __tsan_release(void* address);
#endif

namespace nilio::core {

inline void sanitizer_release([[maybe_unused]] void* token) {
#if defined(__SANITIZE_THREAD__)
  __tsan_release(token);
#endif
}

inline void sanitizer_acquire([[maybe_unused]] void* token) {
#if defined(__SANITIZE_THREAD__)
  __tsan_acquire(token);
#endif
}

}  // namespace nilio::core
