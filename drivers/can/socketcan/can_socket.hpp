#pragma once

#include "nilio/core/result.hpp"
#include "nilio/drivers/packet.hpp"

#include "drivers/common/socket.hpp"

#include <cstddef>
#include <linux/can.h>
#include <optional>
#include <string>

namespace nilio::drivers {

/// Converts the kernel's frame of `size` bytes (16 = CAN, 72 = CAN FD), without stamps. Empty for other
/// sizes and for lengths beyond the frame.
std::optional<CanFrame> from_kernel_frame(const canfd_frame& frame, std::size_t size);

struct KernelFrame {
  canfd_frame frame{};
  /// Bytes to write to the socket.
  std::size_t size = 0;
};

/// The inverse. Empty for error frames, which only a controller makes, and for invalid identifiers and
/// lengths.
std::optional<KernelFrame> to_kernel_frame(const CanFrame& frame);

struct BoundCanSocket {
  FileDescriptor socket;
  unsigned interface_index = 0;
};

/// Makes a raw, non-blocking socket that takes CAN FD frames. Errors name the interface and the command that
/// helps.
core::Result<FileDescriptor> make_can_socket(const std::string& interface_name);
/// Binds the socket, last, so that its options are in force from the first frame on. Refuses interfaces that
/// are not CAN: some of libsocketcan's calls would act on them.
core::Result<BoundCanSocket> bind_can_socket(FileDescriptor socket, const std::string& interface_name);

}  // namespace nilio::drivers
