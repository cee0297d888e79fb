#pragma once

// TBB as Debian builds it is not instrumented, so ThreadSanitizer cannot see that what was written before a
// parallel loop is seen by its leaves, and that they are done when it returns. These two calls tell it; in
// other builds they are nothing.
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
