#pragma once

#include "nilio/core/result.hpp"

#include <array>
#include <cstdint>

namespace nilio::tools {

/// Two UDP ports of 127.0.0.1 that nobody listens to at the moment: `first` and the next, or any for 0. Fails
/// when `first` is taken.
core::Result<std::array<std::uint16_t, 2>> free_udp_ports(std::uint16_t first);

}  // namespace nilio::tools
