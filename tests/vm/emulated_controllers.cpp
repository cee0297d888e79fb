#include "tests/vm/emulated_controllers.hpp"

#include "drivers/can/socketcan/can_interface.hpp"
#include "tests/vm/vm_support.hpp"

#include <cstdlib>
#include <fstream>

#include <catch2/catch.hpp>

namespace nilio::tests {

namespace {

bool insert_module(const std::string& name) {
  return shell("busybox insmod " + std::string(std::getenv("NILIO_KERNEL")) + "/" + name) == 0;
}

}  // namespace

void reset_controllers() {
  for (const std::string name : {"can0", "can1"}) {
    drivers::set_up_can_interface(name, 250000, 0);
    set_up(name, false);
  }
}

void inject(const std::string& text) {
  static const bool loaded = insert_module("can_inject.ko");
  REQUIRE(loaded);
  REQUIRE((std::ofstream("/proc/can_inject") << text << std::flush).good());
}

void unplug_controllers() { REQUIRE(shell("busybox rmmod kvaser_pci") == 0); }

void plug_in_controllers() { REQUIRE(insert_module("kvaser_pci.ko")); }

}  // namespace nilio::tests
