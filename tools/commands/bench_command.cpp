#include "tools/bench/basin/basin.hpp"
#include "tools/bench/decode/decode.hpp"
#include "tools/bench/odometry/odometry.hpp"
#include "tools/bench/realtime/realtime.hpp"
#include "tools/bench/receive/receive.hpp"
#include "tools/bench/soak/soak.hpp"
#include "tools/common/commands.hpp"

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
