#pragma once

#include "nilio/core/result.hpp"

#include <cstddef>

namespace nilio::ipc {

/// Zeroed memory aligned to at least a cache line: on the heap, or in a memfd that another process can map.
class MemoryBlock {
 public:
  /// Throws std::bad_alloc.
  static MemoryBlock on_heap(std::size_t bytes);
  /// Creates a memfd, close-on-exec, sealed against resizing, so that no other process can remove pages
  /// (which would cause a SIGBUS here). All pages are touched.
  static core::Result<MemoryBlock> in_shared_memory(std::size_t bytes);
  /// Maps an existing memfd completely. The descriptor stays with the caller, who may close it.
  static core::Result<MemoryBlock> map(int file_descriptor);

  MemoryBlock(MemoryBlock&& other) noexcept;
  MemoryBlock& operator=(MemoryBlock&& other) noexcept;
  MemoryBlock(const MemoryBlock&) = delete;
  MemoryBlock& operator=(const MemoryBlock&) = delete;
  ~MemoryBlock();

  [[nodiscard]] std::byte* data() const noexcept { return data_; }
  [[nodiscard]] std::size_t bytes() const noexcept { return bytes_; }
  /// -1 unless made by in_shared_memory().
  [[nodiscard]] int file_descriptor() const noexcept { return file_descriptor_; }

 private:
  MemoryBlock(std::byte* data, std::size_t bytes, bool mapped, int file_descriptor) noexcept
      : data_(data), bytes_(bytes), mapped_(mapped), file_descriptor_(file_descriptor) {}
  void release() noexcept;

  std::byte* data_ = nullptr;
  std::size_t bytes_ = 0;
  bool mapped_ = false;
  int file_descriptor_ = -1;
};

}  // namespace nilio::ipc
