#pragma once

#include "drivers/can/socketcan/can_interface.hpp"
#include "tests/vm/vm_support.hpp"

#include <cstdlib>
#include <fstream>
#include <string>

#include <catch2/catch.hpp>

/// Two PCI controllers of the kvaser_pci driver, can0 and can1, on one bus.
namespace nilio::tests {

inline bool insert_module(const std::string& name) {
  return shell("busybox insmod " + std::string(std::getenv("NILIO_KERNEL")) + "/" + name) == 0;
}

/// Sets both down and without automatic restart.
inline void reset_controllers() {
  for (const std::string name : {"can0", "can1"}) {
    drivers::set_up_can_interface(name, 250000, 0);
    set_up(name, false);
  }
}

/// Injects "can1 bus-off", also warning, passive, active, as reported by the controller to its driver.
inline void inject(const std::string& text) {
  static const bool loaded = insert_module("can_inject.ko");
  REQUIRE(loaded);
  REQUIRE((std::ofstream("/proc/can_inject") << text << std::flush).good());
}

/// Removes both together with their driver.
inline void unplug_controllers() { REQUIRE(shell("busybox rmmod kvaser_pci") == 0); }

inline void plug_in_controllers() { REQUIRE(insert_module("kvaser_pci.ko")); }

}  // namespace nilio::tests
