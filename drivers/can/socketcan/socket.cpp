#include "drivers/can/socketcan/socket.hpp"

#include <cerrno>
#include <cstring>
#include <linux/can.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <net/if_arp.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

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

/// True for ARPHRD_CAN; asks by the socket itself, which every network device answers.
bool is_can_interface(int descriptor, const std::string& name) {
  ifreq request{};
  std::strncpy(request.ifr_name, name.c_str(), IFNAMSIZ - 1);
  return ioctl(descriptor, SIOCGIFHWADDR, &request) == 0 && request.ifr_hwaddr.sa_family == ARPHRD_CAN;
}

}  // namespace

CanSocket::~CanSocket() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

core::Result<CanSocket> make_can_socket(const std::string& interface_name) {
  const std::string where = "CAN " + interface_name + ": ";
  if (interface_name.empty() || interface_name.size() >= IFNAMSIZ)
    return Error{where + "is no interface name; write it as 'ip link' shows it, such as can0"};
  CanSocket socket(::socket(PF_CAN, SOCK_RAW | SOCK_CLOEXEC | SOCK_NONBLOCK, CAN_RAW));
  if (socket.get() < 0) {
    const int error = errno;
    return Error{where + "no CAN socket: " + std::strerror(error) + "; " + no_socket_advice(error)};
  }
  const int on = 1;
  if (setsockopt(socket.get(), SOL_CAN_RAW, CAN_RAW_FD_FRAMES, &on, sizeof(on)) != 0)
    return Error{where + "no CAN FD frames: " + std::strerror(errno) + "; Linux 3.6 or newer has them"};
  return socket;
}

core::Result<BoundCanSocket> bind_can_socket(CanSocket socket, const std::string& interface_name) {
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
