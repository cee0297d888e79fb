#include "tools/bench/soak/soak.hpp"

#include "tools/bench/common/sensor_drive.hpp"
#include "tools/bench/odometry/options.hpp"
#include "tools/bench/results_page.hpp"
#include "tools/bench/soak/soak_section.hpp"
#include "tools/commands/number_between.hpp"
#include "tools/common/stop_signals.hpp"

#include <cstdio>
#include <memory>

namespace nilio::tools {

namespace {

using core::Error;
using core::Result;

struct BenchSoakOptions {
  std::vector<std::string> drives;
  SoakPlan plan{60.0, 0.0, 0.25, {}, 0};
  ResultsPage::Options page;
};

/// True when nothing is wrong.
Result<bool> run(const BenchSoakOptions& options) {
  if (options.drives.empty() && options.plan.standing_minutes <= 0.0)
    return Error{"nothing to do: give a DRIVE, or --standing MINUTES"};
  StopSignals signals;
  const Result<std::vector<SensorDrive>> drives = open_sensor_drives(options.drives);
  if (!drives) return drives.error();
  Result<ResultsPage> page = ResultsPage::create(options.page, "Soak: memory over hours");
  if (!page) return page.error();
  const Result<bool> good = add_soak(*drives, options.plan, signals, *page);
  if (!good) return good;
  if (const auto saved = page->save(); !saved) return saved.error();
  return good;
}

}  // namespace

void add_bench_soak(CLI::App& bench) {
  const auto options = std::make_shared<BenchSoakOptions>();
  CLI::App* const command =
      bench.add_subcommand("soak", "Hours of drives in minutes: does memory grow, is every pose counted");
  command->footer("Exit status: 0; 1 when memory grows, poses are missing, or something could not be run.");
  command->add_option(
      "drives", options->drives,
      "folders of 'nilio simulate' or of recordings, or captures; those of another LiDAR are played "
      "apart");
  command->add_option("--minutes", options->plan.minutes, "recorded time to play, in a loop")
      ->check(number_between(0.1, 1e5))
      ->capture_default_str();
  command
      ->add_option("--standing", options->plan.standing_minutes,
                   "also simulate standing beside a road and play so many minutes of it")
      ->check(number_between(0.1, 1e5));
  command
      ->add_option(
          "--warm-up", options->plan.warm_up_share,
          "share of the time after which memory is judged: by then the map has been as large as it gets")
      ->check(number_between(0.01, 0.9))
      ->capture_default_str();
  add_domain_option(*command, options->plan.domain);
  add_page_options(*command, options->page);
  add_override_option(*command, options->plan.overrides, "configuration of all runs; may be repeated");
  command->callback([options, command] { end_bench(*command, run(*options)); });
}

}  // namespace nilio::tools
