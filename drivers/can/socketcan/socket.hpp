#pragma once

#include "nilio/core/result.hpp"

#include <string>
#include <utility>

namespace nilio::drivers {

/// A descriptor that is closed with its object.
class CanSocket {
 public:
  CanSocket() = default;
  explicit CanSocket(int descriptor) : descriptor_(descriptor) {}
  CanSocket(CanSocket&& other) noexcept : descriptor_(other.release()) {}
  CanSocket& operator=(CanSocket&& other) noexcept {
    std::swap(descriptor_, other.descriptor_);
    return *this;
  }
  CanSocket(const CanSocket&) = delete;
  CanSocket& operator=(const CanSocket&) = delete;
  ~CanSocket();
  [[nodiscard]] int get() const { return descriptor_; }
  [[nodiscard]] int release() { return std::exchange(descriptor_, -1); }

 private:
  int descriptor_ = -1;
};

struct BoundCanSocket {
  CanSocket socket;
  unsigned interface_index = 0;
};

/// A raw, non-blocking socket that takes CAN FD frames. Refuses what is no CAN interface: some of
/// libsocketcan's calls would act on it. The message names the interface and the command that helps.
core::Result<CanSocket> make_can_socket(const std::string& interface_name);
/// Binds last, so that options are in force from the first frame on.
core::Result<BoundCanSocket> bind_can_socket(CanSocket socket, const std::string& interface_name);

}  // namespace nilio::drivers
