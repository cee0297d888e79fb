#pragma once

#include "nilio/core/time.hpp"

#include <cstdint>

namespace nilio::fuzz {

/// Publishes and subscribes as nilio-publisher and `nilio watch` do, on loopback, until the parent process
/// ends. Writes one byte to standard output when it is ready.
[[noreturn]] void run_victim(std::uint32_t domain);

/// True if a new subscriber on loopback receives a pose within `patience`.
bool receives_pose(std::uint32_t domain, core::Duration patience);

}  // namespace nilio::fuzz
