#pragma once

#include "tools/commands/command_line_fwd.hpp"

namespace nilio::tools {

/// `nilio bench soak`: hours of drives in minutes, and whether memory grows. A failure ends the parsing with
/// CLI::RuntimeError.
void add_bench_soak(CLI::App& bench);

}  // namespace nilio::tools
