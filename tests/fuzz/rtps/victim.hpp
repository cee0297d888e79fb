#pragma once

#include <cstdint>

namespace nilio::fuzz {

/// Publishes and subscribes as nilio-publisher and `nilio watch` do, on loopback, until the parent process
/// ends. Writes one byte to standard output when it is ready.
[[noreturn]] void run_victim(std::uint32_t domain);

}  // namespace nilio::fuzz
