#pragma once

#include <string>

/// Two PCI controllers of the kvaser_pci driver, can0 and can1, on one bus.
namespace nilio::tests {

/// Down and without automatic restart, whatever the test before has left.
void reset_controllers();

/// "can1 bus-off", also warning, passive, active: what the driver does when its controller reports that.
void inject(const std::string& text);

/// Takes both away with their driver.
void unplug_controllers();
void plug_in_controllers();

}  // namespace nilio::tests
