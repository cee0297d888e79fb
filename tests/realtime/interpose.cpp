// Functions of the C and C++ libraries that a real-time thread must not call. This library precedes them, so
// the dynamic linker binds all calls of the program and its libraries to these functions.
#include "tests/realtime/watch.hpp"

#include <cerrno>
#include <cstdarg>
#include <cstdio>
#include <cstring>
#include <dlfcn.h>
#include <pthread.h>
#include <semaphore.h>
#include <sys/mman.h>
#include <typeinfo>
#include <unistd.h>

using nilio::tests::Offence;
namespace interpose = nilio::tests::interpose;

extern "C" {
void* __libc_malloc(std::size_t size);
void* __libc_calloc(std::size_t count, std::size_t size);
void* __libc_realloc(void* memory, std::size_t size);
void* __libc_memalign(std::size_t alignment, std::size_t size);
void __libc_free(void* memory);
}

namespace {

/// Original function hidden by the one defined here.
template <class Function>
Function* hidden(Function*& found, const char* name) {
  if (found == nullptr) found = reinterpret_cast<Function*>(dlsym(RTLD_NEXT, name));
  return found;
}

struct Start {
  void* (*routine)(void*);
  void* argument;
  int role;
};

void* run_worker(void* data) {
  const Start start = *static_cast<Start*>(data);
  __libc_free(data);
  interpose::begin_worker(start.role);
  return start.routine(start.argument);
}

void note_output(int file_descriptor) {
  if (file_descriptor == STDOUT_FILENO || file_descriptor == STDERR_FILENO)
    interpose::called(Offence::kOutput);
}

}  // namespace

// NOLINTBEGIN(readability-identifier-naming): the names are given
#define NILIO_FORWARD(result, name, offence, parameters, arguments) \
  extern "C" result name parameters {                               \
    static result(*real) parameters = nullptr;                      \
    interpose::called(offence);                                     \
    return hidden(real, #name) arguments;                           \
  }

extern "C" void* malloc(std::size_t size) {
  interpose::called(Offence::kAllocation);
  return __libc_malloc(size);
}
extern "C" void* calloc(std::size_t count, std::size_t size) {
  interpose::called(Offence::kAllocation);
  return __libc_calloc(count, size);
}
extern "C" void* realloc(void* memory, std::size_t size) {
  interpose::called(Offence::kAllocation);
  return __libc_realloc(memory, size);
}
extern "C" void* memalign(std::size_t alignment, std::size_t size) {
  interpose::called(Offence::kAllocation);
  return __libc_memalign(alignment, size);
}
extern "C" void* aligned_alloc(std::size_t alignment, std::size_t size) {
  interpose::called(Offence::kAllocation);
  return __libc_memalign(alignment, size);
}
extern "C" int posix_memalign(void** memory, std::size_t alignment, std::size_t size) {
  interpose::called(Offence::kAllocation);
  *memory = __libc_memalign(alignment, size);
  return *memory == nullptr ? ENOMEM : 0;
}
extern "C" void free(void* memory) {
  // free(nullptr) releases no memory and is common in destructors.
  if (memory == nullptr) return;
  interpose::called(Offence::kRelease);
  __libc_free(memory);
}

NILIO_FORWARD(void*, mmap, Offence::kMapping,
              (void* address, std::size_t length, int protection, int flags, int file, off_t offset),
              (address, length, protection, flags, file, offset))
NILIO_FORWARD(int, munmap, Offence::kMapping, (void* address, std::size_t length), (address, length))
NILIO_FORWARD(int, mprotect, Offence::kMapping, (void* address, std::size_t length, int protection),
              (address, length, protection))
NILIO_FORWARD(int, madvise, Offence::kMapping, (void* address, std::size_t length, int advice),
              (address, length, advice))

NILIO_FORWARD(int, pthread_mutex_lock, Offence::kLock, (pthread_mutex_t * mutex), (mutex))
NILIO_FORWARD(int, pthread_mutex_trylock, Offence::kLock, (pthread_mutex_t * mutex), (mutex))
NILIO_FORWARD(int, pthread_mutex_timedlock, Offence::kLock, (pthread_mutex_t * mutex, const timespec* until),
              (mutex, until))
NILIO_FORWARD(int, pthread_rwlock_rdlock, Offence::kLock, (pthread_rwlock_t * lock), (lock))
NILIO_FORWARD(int, pthread_rwlock_wrlock, Offence::kLock, (pthread_rwlock_t * lock), (lock))
NILIO_FORWARD(int, pthread_cond_wait, Offence::kLock, (pthread_cond_t * condition, pthread_mutex_t* mutex),
              (condition, mutex))
NILIO_FORWARD(int, pthread_cond_timedwait, Offence::kLock,
              (pthread_cond_t * condition, pthread_mutex_t* mutex, const timespec* until),
              (condition, mutex, until))
NILIO_FORWARD(int, pthread_cond_clockwait, Offence::kLock,
              (pthread_cond_t * condition, pthread_mutex_t* mutex, clockid_t clock, const timespec* until),
              (condition, mutex, clock, until))
NILIO_FORWARD(int, sem_wait, Offence::kLock, (sem_t * semaphore), (semaphore))

extern "C" ssize_t write(int file, const void* bytes, std::size_t count) {
  static ssize_t (*real)(int, const void*, std::size_t) = nullptr;
  note_output(file);
  return hidden(real, "write")(file, bytes, count);
}
extern "C" std::size_t fwrite(const void* items, std::size_t size, std::size_t count, FILE* stream) {
  static std::size_t (*real)(const void*, std::size_t, std::size_t, FILE*) = nullptr;
  interpose::called(Offence::kOutput);
  return hidden(real, "fwrite")(items, size, count, stream);
}
NILIO_FORWARD(int, fputs, Offence::kOutput, (const char* text, FILE* stream), (text, stream))
NILIO_FORWARD(int, fflush, Offence::kOutput, (FILE * stream), (stream))

extern "C" int pthread_create(pthread_t* thread, const pthread_attr_t* attributes, void* (*routine)(void*),
                              void* argument) {
  static int (*real)(pthread_t*, const pthread_attr_t*, void* (*)(void*), void*) = nullptr;
  const int role = interpose::role_to_inherit();
  if (role < 0) return hidden(real, "pthread_create")(thread, attributes, routine, argument);
  auto* const start = static_cast<Start*>(__libc_malloc(sizeof(Start)));
  *start = {routine, argument, role};
  return hidden(real, "pthread_create")(thread, attributes, run_worker, start);
}

extern "C" void __cxa_throw(void* exception, void* type, void (*destructor)(void*)) {
  static void (*real)(void*, void*, void (*)(void*)) = nullptr;
  interpose::called(Offence::kThrow);
  hidden(real, "__cxa_throw")(exception, type, destructor);
  __builtin_unreachable();
}
extern "C" void __cxa_rethrow() {
  static void (*real)() = nullptr;
  interpose::called(Offence::kThrow);
  hidden(real, "__cxa_rethrow")();
  __builtin_unreachable();
}
// NOLINTEND(readability-identifier-naming)
