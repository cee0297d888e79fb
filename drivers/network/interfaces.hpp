#pragma once

#include "nilio/core/result.hpp"

#include <cstdint>
#include <filesystem>
#include <string>

namespace nilio::drivers {

/// "192.168.1.201" of an address in host byte order.
std::string format_ipv4(std::uint32_t address);
/// Address in host byte order. `use` ("sender") names its purpose in the error message.
core::Result<std::uint32_t> parse_ipv4(const std::string& text, const std::string& use);
/// As parse_ipv4(), but an empty text is 0.0.0.0.
core::Result<std::uint32_t> parse_optional_ipv4(const std::string& text, const std::string& use);

/// "link up", "no link: ..." or "switched off: ..." for a network interface, from sysfs (/sys/class/net).
std::string describe_link(const std::string& interface, const std::filesystem::path& sysfs);

/// One line for the user: the interface with the address or name `wanted` and its link state. For 0.0.0.0:
/// every interface except the loopback that has an address or a cable socket. Allocates and reads files,
/// hence not for the packet path.
std::string describe_interfaces(const std::string& wanted);

}  // namespace nilio::drivers
