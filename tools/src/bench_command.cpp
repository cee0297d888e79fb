#include "bench_basin.hpp"
#include "bench_decode.hpp"
#include "bench_odometry.hpp"
#include "bench_realtime.hpp"
#include "bench_receive.hpp"
#include "bench_soak.hpp"
#include "commands.hpp"

#include <CLI/CLI.hpp>

namespace nilio::tools {

void add_bench_command(CLI::App& app) {
  CLI::App* const bench = app.add_subcommand("bench", "Measure parts of nilio on this machine");
  bench->require_subcommand(1);
  add_bench_basin(*bench);
  add_bench_decode(*bench);
  add_bench_odometry(*bench);
  add_bench_realtime(*bench);
  add_bench_receive(*bench);
  add_bench_soak(*bench);
}

}  // namespace nilio::tools
