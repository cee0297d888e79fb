#include "drivers/can/socketcan/frame.hpp"

#include <algorithm>

namespace nilio::drivers {

std::optional<CanFrame> from_kernel_frame(const canfd_frame& frame, std::size_t size) {
  const bool flexible = size == CANFD_MTU;
  const std::size_t largest = flexible ? CANFD_MAX_DLEN : CAN_MAX_DLEN;
  if ((size != CAN_MTU && size != CANFD_MTU) || frame.len > largest) return std::nullopt;
  CanFrame result;
  result.error = (frame.can_id & CAN_ERR_FLAG) != 0;
  result.extended = !result.error && (frame.can_id & CAN_EFF_FLAG) != 0;
  result.remote = !result.error && (frame.can_id & CAN_RTR_FLAG) != 0;
  result.id = frame.can_id & (result.error || result.extended ? CAN_EFF_MASK : CAN_SFF_MASK);
  result.flexible_data_rate = flexible;
  result.length = frame.len;
  std::copy_n(frame.data, frame.len, result.data.begin());
  return result;
}

std::optional<KernelFrame> to_kernel_frame(const CanFrame& frame) {
  const std::size_t largest = frame.flexible_data_rate ? CANFD_MAX_DLEN : CAN_MAX_DLEN;
  const std::uint32_t largest_id = frame.extended ? CAN_EFF_MASK : CAN_SFF_MASK;
  if (frame.error || frame.length > largest || frame.id > largest_id) return std::nullopt;
  KernelFrame result;
  result.size = frame.flexible_data_rate ? CANFD_MTU : CAN_MTU;
  result.frame.can_id = frame.id | (frame.extended ? CAN_EFF_FLAG : 0U) | (frame.remote ? CAN_RTR_FLAG : 0U);
  result.frame.len = frame.length;
  if (!frame.remote) std::copy_n(frame.data.begin(), frame.length, result.frame.data);
  return result;
}

}  // namespace nilio::drivers
