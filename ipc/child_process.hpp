#pragma once

#include "nilio/core/result.hpp"

#include <string>
#include <sys/types.h>
#include <vector>

namespace nilio::ipc {

/// First descriptor that a child inherits; the others follow without gaps.
inline constexpr int kFirstInheritedDescriptor = 3;

/// Starts the program `arguments.front()` with copies of the descriptors from kFirstInheritedDescriptor on,
/// and no others but the standard ones. Its signals have their defaults; SIGTERM and SIGINT are blocked until
/// it reads them from its signalfd. It has its own process group, so that Ctrl-C on the terminal reaches only
/// the parent, which then stops it in order, and normal scheduling.
core::Result<pid_t> spawn_child(std::vector<std::string> arguments, const std::vector<int>& descriptors);

}  // namespace nilio::ipc
