#include "ipc/memory_block.hpp"

#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <limits>
#include <new>
#include <string>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>
#include <utility>

namespace nilio::ipc {
namespace {

constexpr std::size_t kAlignment = 64;

core::Error system_error(const std::string& what) { return {what + ": " + std::strerror(errno)}; }

void* map_shared(int file_descriptor, std::size_t bytes) {
  return mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_POPULATE, file_descriptor, 0);
}

}  // namespace

MemoryBlock MemoryBlock::on_heap(std::size_t bytes) {
  auto* data = static_cast<std::byte*>(::operator new (bytes, std::align_val_t{kAlignment}));
  std::memset(data, 0, bytes);
  return {data, bytes, false, -1};
}

core::Result<MemoryBlock> MemoryBlock::in_shared_memory(std::size_t bytes) {
  const std::string where = "shared memory of " + std::to_string(bytes) + " bytes";
  if (bytes == 0 || bytes > static_cast<std::size_t>(std::numeric_limits<off_t>::max()))
    return core::Error{where + " cannot be created - choose a smaller capacity"};
  const int file_descriptor = memfd_create("nilio-shared", MFD_CLOEXEC | MFD_ALLOW_SEALING);
  if (file_descriptor < 0) return system_error("memfd_create for " + where);
  if (ftruncate(file_descriptor, static_cast<off_t>(bytes)) != 0 ||
      fcntl(file_descriptor, F_ADD_SEALS, F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_SEAL) != 0) {
    const core::Error error = system_error("sizing " + where);
    close(file_descriptor);
    return error;
  }
  void* const data = map_shared(file_descriptor, bytes);
  if (data == MAP_FAILED) {
    const core::Error error = system_error("mapping " + where);
    close(file_descriptor);
    return error;
  }
  return MemoryBlock{static_cast<std::byte*>(data), bytes, true, file_descriptor};
}

core::Result<MemoryBlock> MemoryBlock::map(int file_descriptor) {
  const std::string where = "file descriptor " + std::to_string(file_descriptor);
  struct stat status {};
  if (fstat(file_descriptor, &status) != 0)
    return system_error(where + " cannot be mapped as shared memory (it must be a ring's memfd)");
  const int seals = fcntl(file_descriptor, F_GET_SEALS);
  if (seals < 0 || (seals & F_SEAL_SHRINK) == 0)
    return core::Error{where + " is not a ring's shared memory (no memfd sealed against shrinking)"};
  if (status.st_size <= 0) return core::Error{where + " is empty shared memory"};
  const auto bytes = static_cast<std::size_t>(status.st_size);
  void* const data = map_shared(file_descriptor, bytes);
  if (data == MAP_FAILED) return system_error("mapping " + where);
  return MemoryBlock{static_cast<std::byte*>(data), bytes, true, -1};
}

MemoryBlock::MemoryBlock(MemoryBlock&& other) noexcept
    : data_(std::exchange(other.data_, nullptr)),
      bytes_(std::exchange(other.bytes_, 0)),
      mapped_(other.mapped_),
      file_descriptor_(std::exchange(other.file_descriptor_, -1)) {}

MemoryBlock& MemoryBlock::operator=(MemoryBlock&& other) noexcept {
  if (this == &other) return *this;
  release();
  data_ = std::exchange(other.data_, nullptr);
  bytes_ = std::exchange(other.bytes_, 0);
  mapped_ = other.mapped_;
  file_descriptor_ = std::exchange(other.file_descriptor_, -1);
  return *this;
}

MemoryBlock::~MemoryBlock() { release(); }

void MemoryBlock::release() noexcept {
  if (data_ != nullptr) {
    if (mapped_)
      munmap(data_, bytes_);
    else
      ::operator delete (data_, std::align_val_t{kAlignment});
  }
  if (file_descriptor_ >= 0) close(file_descriptor_);
}

}  // namespace nilio::ipc
