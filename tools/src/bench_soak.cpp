#include "bench_soak.hpp"

#include "bench_options.hpp"
#include "child_process.hpp"
#include "niliod_run.hpp"
#include "number_between.hpp"
#include "results_page.hpp"
#include "soak_report.hpp"
#include "soak_run.hpp"
#include "stop_signals.hpp"
#include "work_folder.hpp"

#include <algorithm>
#include <cstdio>
#include <memory>

namespace nilio::tools {

namespace {

namespace fs = std::filesystem;
using core::Duration;
using core::Error;
using core::Result;

constexpr double kMinuteS = 60.0;
constexpr int kPictureWidth = 1200;
constexpr int kPictureHeight = 520;
/// Of standing that is simulated; it is played over and over, as nothing but the traffic jumps at the seam.
constexpr double kStandingLapS = 120.0;
constexpr Duration kSimulationLimit = Duration::from_seconds(1800.0);
constexpr const char* kLegend =
    "niliod's pipeline in this process and nilio-publisher beside it, as fast as they go. The drives are "
    "played forwards one after the other, again and again, with all stamps moved on: at each seam the "
    "vehicle is somewhere else within 0.1 s, which odometry has to lose and find its way in. Memory: "
    "anonymous pages, counted one by one at every second of recorded time; the slope is per recorded "
    "minute, by least squares after the warm-up; its standard error takes into account that neighbouring "
    "samples are alike.";

struct BenchSoakOptions {
  std::vector<std::string> drives;
  double minutes = 60.0;
  double standing_minutes = 0.0;
  double warm_up_share = 0.25;
  SoakConfig run;
  ResultsPage::Options page;
};

SoakConfig config_for(const BenchSoakOptions& options, double minutes, bool standing) {
  SoakConfig config = options.run;
  config.length = Duration::from_seconds(minutes * kMinuteS);
  config.warm_up = Duration::from_seconds(minutes * kMinuteS * options.warm_up_share);
  config.standing = standing;
  return config;
}

Result<NamedSoak> soak(const std::string& name, std::span<const SensorDrive> drives, const SoakConfig& config,
                       StopSignals& signals) {
  Result<SoakResult> result = run_soak(drives, config, signals);
  if (!result) return Error{name + ": " + result.error().message};
  for (const std::string& note : result->notes) std::fprintf(stderr, "%s: %s\n", name.c_str(), note.c_str());
  return NamedSoak{name, std::move(result).value()};
}

Result<NamedSoak> soak_moving(const BenchSoakOptions& options, StopSignals& signals) {
  std::vector<SensorDrive> drives;
  for (const std::string& argument : options.drives) {
    Result<SensorDrive> drive = open_sensor_drive(argument);
    if (!drive) return drive.error();
    drives.push_back(std::move(drive).value());
  }
  return soak("moving", drives, config_for(options, options.minutes, false), signals);
}

Result<NamedSoak> soak_standing(const BenchSoakOptions& options, StopSignals& signals) {
  const Result<fs::path> nilio = find_sibling_program("nilio");
  if (!nilio) return nilio.error();
  const Result<WorkFolder> work = WorkFolder::create();
  if (!work) return work.error();
  const std::string folder = (work->path() / "standstill").string();
  const double seconds = std::min(kStandingLapS, options.standing_minutes * kMinuteS);
  Result<ChildProcess> simulation = ChildProcess::start(
      *nilio, {"simulate", folder, "--scene", "standstill", "--duration", std::to_string(seconds)},
      work->path() / "simulate.log");
  if (!simulation) return simulation.error();
  const auto simulated = await_end(*simulation, kSimulationLimit, signals);
  if (!simulated) return simulated.error();
  Result<SensorDrive> drive = open_sensor_drive(folder);
  if (!drive) return drive.error();
  return soak("standing", std::span(&*drive, 1), config_for(options, options.standing_minutes, true),
              signals);
}

Result<std::monostate> add_picture(std::span<const NamedSoak> runs, ResultsPage& page) {
  if (!page.wants_pictures()) return std::monostate{};
  auto canvas = page.new_picture("memory", kPictureWidth, kPictureHeight);
  if (!canvas) return canvas.error();
  draw_chart(*canvas, memory_chart(runs));
  return page.picture("memory", "Allocated memory that is resident", *canvas);
}

/// True when nothing is wrong.
Result<bool> run(const BenchSoakOptions& options) {
  if (options.drives.empty() && options.standing_minutes <= 0.0)
    return Error{"nothing to do: give a DRIVE, or --standing MINUTES"};
  StopSignals signals;
  Result<ResultsPage> page = ResultsPage::create(options.page, "Soak: memory over hours");
  if (!page) return page.error();
  page->paragraph(kLegend);
  std::vector<NamedSoak> runs;
  const auto keep = [&runs](Result<NamedSoak> soaked) -> Result<std::monostate> {
    if (!soaked) return soaked.error();
    runs.push_back(std::move(soaked).value());
    return std::monostate{};
  };
  if (!options.drives.empty()) {
    if (auto kept = keep(soak_moving(options, signals)); !kept) return kept.error();
  }
  if (options.standing_minutes > 0.0) {
    if (auto kept = keep(soak_standing(options, signals)); !kept) return kept.error();
  }
  page->table("Poses", soak_table(runs));
  page->table("Memory", soak_memory_table(runs));
  if (auto added = add_picture(runs, *page); !added) return added.error();
  bool good = true;
  for (const NamedSoak& soaked : runs) {
    for (const std::string& fault : find_faults(soaked.result)) {
      page->paragraph("FAIL, " + soaked.name + ": " + fault);
      good = false;
    }
  }
  if (good) page->paragraph("PASS");
  if (const auto saved = page->save(); !saved) return saved.error();
  return good;
}

}  // namespace

void add_bench_soak(CLI::App& bench) {
  const auto options = std::make_shared<BenchSoakOptions>();
  CLI::App* const command =
      bench.add_subcommand("soak", "Hours of drives in minutes: does memory grow, is every pose counted");
  command->footer("Exit status: 0; 1 when memory grows, poses are missing, or something could not be run.");
  command->add_option("drives", options->drives,
                      "folders of 'nilio simulate' or of recordings, or captures, all of the same LiDAR");
  command->add_option("--minutes", options->minutes, "recorded time to play, in a loop")
      ->check(number_between(0.1, 1e5))
      ->capture_default_str();
  command
      ->add_option("--standing", options->standing_minutes,
                   "also simulate standing beside a road and play so many minutes of it")
      ->check(number_between(0.1, 1e5));
  command
      ->add_option(
          "--warm-up", options->warm_up_share,
          "share of the time after which memory is judged: by then the map has been as large as it gets")
      ->check(number_between(0.01, 0.9))
      ->capture_default_str();
  add_domain_option(*command, options->run.domain);
  add_page_options(*command, options->page);
  add_override_option(*command, options->run.overrides, "configuration of all runs; may be repeated");
  command->callback([options, command] { end_bench(*command, run(*options)); });
}

}  // namespace nilio::tools
