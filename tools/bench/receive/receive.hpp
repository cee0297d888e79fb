#pragma once

#include "tools/commands/command_line_fwd.hpp"

namespace nilio::tools {

/// Adds `receive` to the group `bench`: sends packets through loopback as fast as a sensor and several times
/// faster, and tells what was lost and whether each loss was counted. Ends the program with status 1 when one
/// was not, or when packets were lost without a stall.
void add_bench_receive(CLI::App& bench);

}  // namespace nilio::tools
