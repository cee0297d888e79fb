#pragma once

#include "tools/commands/command_line_fwd.hpp"

namespace nilio::tools {

/// `nilio bench decode`: nanoseconds per point from packet to scan, for every model.
void add_bench_decode(CLI::App& bench);

}  // namespace nilio::tools
