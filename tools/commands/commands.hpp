#pragma once

// CLI11 takes long to compile: only the definitions of commands include it.
namespace CLI {
class App;
}

namespace nilio::tools {

/// Each adds one command to `nilio`. The command runs while the line is parsed and leaves its exit status in
/// `status` (nilio::ExitStatus; one message on standard error where it failed).
void add_simulate_command(CLI::App& app, int& status);
void add_mangle_command(CLI::App& app, int& status);
void add_convert_command(CLI::App& app, int& status);
void add_evaluate_command(CLI::App& app, int& status);
void add_inspect_command(CLI::App& app, int& status);
void add_init_command(CLI::App& app, int& status);
void add_map_command(CLI::App& app, int& status);
void add_plot_command(CLI::App& app, int& status);
void add_watch_command(CLI::App& app, int& status);
void add_view_command(CLI::App& app, int& status);
void add_record_command(CLI::App& app, int& status);
void add_play_command(CLI::App& app, int& status);
void add_report_command(CLI::App& app, int& status);
void add_reference_command(CLI::App& app, int& status);
/// A group of measurements; one that fails ends the parsing with CLI::RuntimeError.
void add_bench_command(CLI::App& app);

}  // namespace nilio::tools
