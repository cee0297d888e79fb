#include "drivers/can/socketcan/can_socket.hpp"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <linux/can/raw.h>
#include <net/if.h>
#include <net/if_arp.h>
#include <sys/ioctl.h>
#include <sys/socket.h>

namespace nilio::drivers {
namespace {

using core::Error;

std::string no_socket_advice(int error) {
  if (error == EAFNOSUPPORT)
    return "this kernel has no CAN sockets loaded; 'modprobe can' and 'modprobe can_raw' as root, or boot a "
           "kernel that has them";
  if (error == EPROTONOSUPPORT) return "the kernel's raw CAN protocol is missing; 'modprobe can_raw' as root";
  if (error == EPERM || error == EACCES)
    return "the service may not use AF_CAN; add it to RestrictAddressFamilies of the systemd unit";
  return "check the kernel's CAN support with 'lsmod | grep can'";
}

/// True for ARPHRD_CAN, read through the socket itself.
bool is_can_interface(int descriptor, const std::string& name) {
  ifreq request{};
  std::strncpy(request.ifr_name, name.c_str(), IFNAMSIZ - 1);
  return ioctl(descriptor, SIOCGIFHWADDR, &request) == 0 && request.ifr_hwaddr.sa_family == ARPHRD_CAN;
}

}  // namespace

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

core::Result<FileDescriptor> make_can_socket(const std::string& interface_name) {
  const std::string where = "CAN " + interface_name + ": ";
  if (interface_name.empty() || interface_name.size() >= IFNAMSIZ)
    return Error{where + "is no interface name; write it as 'ip link' shows it, such as can0"};
  FileDescriptor socket(::socket(PF_CAN, SOCK_RAW | SOCK_CLOEXEC | SOCK_NONBLOCK, CAN_RAW));
  if (!socket.is_open()) {
    const int error = errno;
    return Error{where + "no CAN socket: " + std::strerror(error) + "; " + no_socket_advice(error)};
  }
  if (!set_socket_option(socket.get(), SOL_CAN_RAW, CAN_RAW_FD_FRAMES, 1))
    return Error{where + "no CAN FD frames: " + std::strerror(errno) + "; Linux 3.6 or newer has them"};
  return socket;
}

core::Result<BoundCanSocket> bind_can_socket(FileDescriptor socket, const std::string& interface_name) {
  const std::string where = "CAN " + interface_name + ": ";
  const unsigned index = if_nametoindex(interface_name.c_str());
  if (index == 0)
    return Error{where +
                 "there is no such interface; 'ip link show type can' lists them, and a missing one "
                 "lacks its adapter or its driver"};
  if (!is_can_interface(socket.get(), interface_name))
    return Error{where + "is no CAN interface; 'ip link show type can' lists them"};
  sockaddr_can address{};
  address.can_family = AF_CAN;
  address.can_ifindex = static_cast<int>(index);
  if (bind(socket.get(), reinterpret_cast<const sockaddr*>(&address), sizeof(address)) != 0)
    return Error{where + "cannot be listened on: " + std::strerror(errno) +
                 "; check it with 'ip -details link "
                 "show " +
                 interface_name + "'"};
  return BoundCanSocket{std::move(socket), index};
}

}  // namespace nilio::drivers
