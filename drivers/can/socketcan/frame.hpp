#pragma once

#include "nilio/drivers/packet.hpp"

#include <cstddef>
#include <linux/can.h>
#include <optional>

namespace nilio::drivers {

/// The kernel's frame of `size` bytes (16 = CAN, 72 = CAN FD) in our form, without its stamps; nothing for
/// other sizes and lengths beyond the frame.
std::optional<CanFrame> from_kernel_frame(const canfd_frame& frame, std::size_t size);

struct KernelFrame {
  canfd_frame frame{};
  /// Bytes to hand to the kernel.
  std::size_t size = 0;
};

/// Nothing for error frames, which only a controller makes, and for identifiers and lengths that do not
/// exist.
std::optional<KernelFrame> to_kernel_frame(const CanFrame& frame);

}  // namespace nilio::drivers
