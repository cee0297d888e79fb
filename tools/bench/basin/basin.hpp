#pragma once

#include "tools/commands/command_line_fwd.hpp"

namespace nilio::tools {

/// `nilio bench basin`: from how far away each registration method finds home. A failure ends the parsing
/// with CLI::RuntimeError.
void add_bench_basin(CLI::App& bench);

}  // namespace nilio::tools
