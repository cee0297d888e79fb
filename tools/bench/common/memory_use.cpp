#include "tools/bench/common/memory_use.hpp"

#include <cstddef>
#include <cstdlib>
#include <fstream>
#include <malloc.h>
#include <new>
#include <sstream>
#include <string>
#include <string_view>

namespace {

thread_local std::int64_t allocations = 0;

/// Bytes of a line "VmRSS:   1234 kB"; empty when the line does not begin with `key`.
std::optional<std::uint64_t> line_bytes(const std::string& line, std::string_view key) {
  if (!line.starts_with(key)) return std::nullopt;
  std::istringstream text(line.substr(key.size()));
  std::uint64_t kibibytes = 0;
  if (!(text >> kibibytes)) return std::nullopt;
  return kibibytes * 1024;
}

/// Bytes of the first line with that key in a file; 0 when there is none.
std::uint64_t file_bytes(const char* path, std::string_view key) {
  std::ifstream file(path);
  std::string line;
  while (std::getline(file, line)) {
    if (const auto bytes = line_bytes(line, key)) return *bytes;
  }
  return 0;
}

}  // namespace

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr bool kCounted = false;
#else
constexpr bool kCounted = true;

void* operator new(std::size_t size) {
  ++allocations;
  if (void* memory = std::malloc(size == 0 ? 1 : size)) return memory;
  throw std::bad_alloc();
}
void* operator new(std::size_t size, std::align_val_t alignment) {
  ++allocations;
  const auto align = static_cast<std::size_t>(alignment);
  // aligned_alloc() needs a multiple of the alignment.
  if (void* memory = std::aligned_alloc(align, (size + align - 1) / align * align)) return memory;
  throw std::bad_alloc();
}
void operator delete(void* memory) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t /*size*/) noexcept { std::free(memory); }
void operator delete(void* memory, std::align_val_t /*alignment*/) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t /*size*/, std::align_val_t /*alignment*/) noexcept {
  std::free(memory);
}
#endif

namespace nilio::tools::bench {

std::int64_t allocation_count() { return allocations; }

bool allocations_are_counted() { return kCounted; }

std::uint64_t reset_peak_resident() {
  malloc_trim(0);
  // proc(5): 5 resets the high water mark.
  std::ofstream("/proc/self/clear_refs") << '5' << std::flush;
  return file_bytes("/proc/self/status", "VmRSS:");
}

std::uint64_t peak_resident() { return file_bytes("/proc/self/status", "VmHWM:"); }

std::optional<ResidentMemory> resident_memory(pid_t process) {
  std::ifstream file("/proc/" + std::to_string(process) + "/smaps_rollup");
  ResidentMemory memory;
  std::string line;
  while (std::getline(file, line)) {
    if (const auto total = line_bytes(line, "Rss:")) memory.total = *total;
    if (const auto anonymous = line_bytes(line, "Anonymous:")) memory.anonymous = *anonymous;
  }
  if (memory.total == 0) return std::nullopt;
  return memory;
}

std::uint64_t available_memory() { return file_bytes("/proc/meminfo", "MemAvailable:"); }

}  // namespace nilio::tools::bench
