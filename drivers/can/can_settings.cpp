#include "drivers/can/can_settings.hpp"

#include "drivers/can/socketcan/state.hpp"

#include <linux/can/netlink.h>
#include <linux/capability.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <libsocketcan.h>

namespace nilio::drivers {
namespace {

/// Drivers that cannot restart, or may not: kernels from before 2025 do not check and fall over when asked.
/// Serial adapters (slcan) have no device, and show the kind of their interface instead of a driver.
bool lacks_restart(const std::string& driver) {
  return driver.empty() || driver == "can" || driver == "gs_usb" || driver == "slcan";
}

}  // namespace

bool may_set_up_interfaces() {
  __user_cap_header_struct header{.version = _LINUX_CAPABILITY_VERSION_3, .pid = 0};
  __user_cap_data_struct data[_LINUX_CAPABILITY_U32S_3]{};
  if (syscall(SYS_capget, &header, data) != 0) return false;
  return (data[CAP_TO_INDEX(CAP_NET_ADMIN)].effective & CAP_TO_MASK(CAP_NET_ADMIN)) != 0;
}

void set_up_can_interface(const std::string& name, std::uint32_t bitrate, std::uint32_t restart_ms) {
  const CanInterfaceState before = look_at_can_interface(name);
  if (!before.is_can) return;
  can_do_stop(name.c_str());
  if (!runs_at(before, bitrate)) can_set_bitrate(name.c_str(), bitrate);
  const bool restarts = restart_ms == 0 || !lacks_restart(before.driver);
  if (restarts && before.restart_ms != restart_ms) can_set_restart_ms(name.c_str(), restart_ms);
  if (before.up || runs_at(look_at_can_interface(name), bitrate)) can_do_start(name.c_str());
}

void restart_can_controller(const std::string& name, const std::string& driver) {
  if (!lacks_restart(driver)) {
    can_do_restart(name.c_str());
    const CanInterfaceState after = look_at_can_interface(name);
    if (!after.is_can || after.controller != CAN_STATE_BUS_OFF) return;
  }
  can_do_stop(name.c_str());
  can_do_start(name.c_str());
}

}  // namespace nilio::drivers
