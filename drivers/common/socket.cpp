#include "drivers/common/socket.hpp"

#include "nilio/core/clock.hpp"

#include <algorithm>
#include <cstring>

namespace nilio::drivers {

std::optional<int> request_receive_buffer(int descriptor, int bytes) {
  // SO_RCVBUFFORCE exceeds net.core.rmem_max, SO_RCVBUF is cut to it.
  if (!set_socket_option(descriptor, SOL_SOCKET, SO_RCVBUFFORCE, bytes)) {
    set_socket_option(descriptor, SOL_SOCKET, SO_RCVBUF, bytes);
  }
  int obtained = 0;
  socklen_t length = sizeof(obtained);
  if (getsockopt(descriptor, SOL_SOCKET, SO_RCVBUF, &obtained, &length) != 0) return std::nullopt;
  // The kernel reports twice the requested size; the second half is for its own bookkeeping.
  return obtained / 2;
}

std::string describe_receive_buffer(int obtained, int requested) {
  std::string text = "receive buffer " + std::to_string(obtained / 1024) + " KiB";
  if (obtained >= requested) return text;
  return text + " of " + std::to_string(requested / 1024) +
         " KiB requested; allow it with 'sysctl -w net.core.rmem_max=" + std::to_string(requested) + "'";
}

ReceivedControl read_control(msghdr& header) {
  ReceivedControl received;
  for (cmsghdr* control = CMSG_FIRSTHDR(&header); control != nullptr;
       control = CMSG_NXTHDR(&header, control)) {
    if (control->cmsg_level != SOL_SOCKET) continue;
    if (control->cmsg_type == SCM_TIMESTAMPNS) {
      timespec stamp{};
      std::memcpy(&stamp, CMSG_DATA(control), sizeof(stamp));
      received.stamp.ns = ns_of(stamp);
    } else if (control->cmsg_type == SO_RXQ_OVFL) {
      std::uint32_t drops = 0;
      std::memcpy(&drops, CMSG_DATA(control), sizeof(drops));
      received.drops = drops;
    }
  }
  if (received.stamp.ns == 0) received.stamp.ns = clock_ns(CLOCK_REALTIME);
  return received;
}

}  // namespace nilio::drivers
