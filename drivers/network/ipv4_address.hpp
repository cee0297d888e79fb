#pragma once

#include "nilio/core/result.hpp"

#include <cstdint>
#include <string>

namespace nilio::drivers {

/// "192.168.1.201" of an address in host byte order.
std::string format_ipv4(std::uint32_t address);
/// Host byte order. `use` ("sender") is for the message.
core::Result<std::uint32_t> parse_ipv4(const std::string& text, const std::string& use);
/// As parse_ipv4, but an empty text is 0.0.0.0.
core::Result<std::uint32_t> parse_optional_ipv4(const std::string& text, const std::string& use);

}  // namespace nilio::drivers
