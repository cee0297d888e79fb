#pragma once

#include "tools/commands/command_line_fwd.hpp"

namespace nilio::tools {

/// `nilio bench odometry`: accuracy, time, memory and work of the odometry on drives with a truth. A failure
/// ends the parsing with CLI::RuntimeError.
void add_bench_odometry(CLI::App& bench);

}  // namespace nilio::tools
