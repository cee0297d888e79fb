#include "nilio/drivers/can/socketcan/socketcan.hpp"

#include "drivers/can/socketcan/frame.hpp"
#include "drivers/can/socketcan/socket.hpp"

#include <cerrno>
#include <linux/can/raw.h>
#include <sys/socket.h>
#include <unistd.h>
#include <utility>

namespace nilio::drivers {

core::Result<CanSender> CanSender::open(const std::string& interface_name) {
  core::Result<CanSocket> socket = make_can_socket(interface_name);
  if (!socket) return socket.error();
  // An empty list of filters: nothing is received, so nothing fills the buffer.
  if (setsockopt(socket->get(), SOL_CAN_RAW, CAN_RAW_FILTER, nullptr, 0) != 0)
    return core::Error{"CAN " + interface_name + ": receiving cannot be switched off; check the kernel"};
  core::Result<BoundCanSocket> bound = bind_can_socket(std::move(socket).value(), interface_name);
  if (!bound) return bound.error();
  return CanSender(bound->socket.release());
}

CanSender::CanSender(CanSender&& other) noexcept : descriptor_(std::exchange(other.descriptor_, -1)) {}

CanSender::~CanSender() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

CanSendResult CanSender::send(const CanFrame& frame) {
  const std::optional<KernelFrame> kernel = to_kernel_frame(frame);
  if (!kernel) return CanSendResult::kRefused;
  const ssize_t written = ::write(descriptor_, &kernel->frame, kernel->size);
  if (written == static_cast<ssize_t>(kernel->size)) return CanSendResult::kSent;
  if (errno == ENOBUFS || errno == EAGAIN || errno == EINTR) return CanSendResult::kQueueFull;
  if (errno == ENETDOWN || errno == ENODEV || errno == ENXIO) return CanSendResult::kDown;
  return CanSendResult::kRefused;
}

}  // namespace nilio::drivers
