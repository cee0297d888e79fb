#pragma once

#include "nilio/core/result.hpp"

#include "ipc/memory_block.hpp"

#include <cstdint>
#include <new>
#include <string>
#include <type_traits>
#include <utility>

namespace nilio::ipc {

/// An object of lock-free atomics in a memfd, shared by two processes. It survives the end of either.
template <class T>
class SharedObject {
  static_assert(std::is_trivially_destructible_v<T>);

 public:
  /// The descriptor is close-on-exec.
  static core::Result<SharedObject> create() {
    auto memory = MemoryBlock::in_shared_memory(sizeof(Content));
    if (!memory) return memory.error();
    ::new (memory->data()) Content;
    return SharedObject(std::move(memory).value());
  }

  /// Maps the object of another process; fails if the memory holds another type. The descriptor stays with
  /// the caller.
  static core::Result<SharedObject> attach(int file_descriptor) {
    auto memory = MemoryBlock::map(file_descriptor);
    if (!memory) return memory.error();
    const auto* content = reinterpret_cast<const Content*>(memory->data());
    if (memory->bytes() != sizeof(Content) || content->magic != kMagic || content->bytes != sizeof(T))
      return core::Error{"file descriptor " + std::to_string(file_descriptor) +
                         ": not the shared object of this program - install matching programs"};
    return SharedObject(std::move(memory).value());
  }

  [[nodiscard]] T& operator*() const noexcept {
    return std::launder(reinterpret_cast<Content*>(memory_.data()))->value;
  }
  [[nodiscard]] T* operator->() const noexcept { return &**this; }
  /// memfd to pass to another process; -1 if attached.
  [[nodiscard]] int file_descriptor() const noexcept { return memory_.file_descriptor(); }

 private:
  static constexpr std::uint64_t kMagic = 0x4A42'4F4F'494C'494E;  // "NILIOOBJ", little endian
  struct Content {
    std::uint64_t magic = kMagic;
    std::uint64_t bytes = sizeof(T);
    T value;
  };

  explicit SharedObject(MemoryBlock memory) : memory_(std::move(memory)) {}

  MemoryBlock memory_;
};

}  // namespace nilio::ipc
