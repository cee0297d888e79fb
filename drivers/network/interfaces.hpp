#pragma once

#include <filesystem>
#include <string>

namespace nilio::drivers {

/// "link up", "no link: ..." or "switched off: ..." for an interface, from sysfs
/// (/sys/class/net).
std::string describe_link(const std::string& interface, const std::filesystem::path& sysfs);

/// The interface that has the address or name `wanted` with its link state; for 0.0.0.0 every one but the
/// loopback that has an address or a socket for a cable. One line for a person. Allocates and reads files:
/// not for the packet path.
std::string describe_interfaces(const std::string& wanted);

}  // namespace nilio::drivers
