#pragma once

#include <string>

/// Two PCI controllers of the kvaser_pci driver, can0 and can1, on one bus.
namespace nilio::tests {

/// Sets both down and without automatic restart, whatever state the previous test left.
void reset_controllers();

/// Injects "can1 bus-off", also warning, passive, active, as reported by the controller to its driver.
void inject(const std::string& text);

/// Removes both together with their driver.
void unplug_controllers();
void plug_in_controllers();

}  // namespace nilio::tests
