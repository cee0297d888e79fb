#pragma once

#include "tools/commands/command_line_fwd.hpp"

namespace nilio::tools {

/// `nilio bench realtime`: niliod with its publisher at the sensor's pace, under budgets and loads, and
/// whether the same input gives the same poses. A failure ends the parsing with CLI::RuntimeError.
void add_bench_realtime(CLI::App& bench);

}  // namespace nilio::tools
