#include "tools/bench/soak/soak.hpp"

#include "daemon/input/input.hpp"
#include "tools/bench/common/niliod_run.hpp"
#include "tools/bench/soak/soak_run.hpp"
#include "tools/common/child_process.hpp"
#include "tools/common/files.hpp"

#include <algorithm>
#include <cstdio>
#include <utility>

namespace nilio::tools::bench {

namespace {

namespace fs = std::filesystem;
using core::Duration;
using core::Error;
using core::Result;

constexpr int kPictureWidth = 1200;
constexpr int kPictureHeight = 520;
/// Length of the simulated standstill, which is played in a loop: only the traffic jumps at a seam.
constexpr double kStationaryLapS = 120.0;
constexpr Duration kSimulationLimit = Duration::from_seconds(1800.0);
constexpr const char* kLegend =
    "niliod's pipeline in this process and nilio-publisher beside it, as fast as possible. The drives are "
    "played "
    "in a loop, with all stamps shifted; at each seam the vehicle is at another place within 0.1 s, so that "
    "tracking is lost and has to recover. Latencies of such a replay are queueing delays and are not shown. "
    "Memory: anonymous pages at every second of recorded time; slope by least squares after the warm-up, per "
    "minute of recorded time; its standard error accounts for the correlation of neighbouring samples.";

/// Drives of one LiDAR model, which can share a loop.
struct DrivesOfModel {
  std::string model;
  std::vector<SensorDrive> drives;
};

Result<std::vector<DrivesOfModel>> by_model(std::span<const SensorDrive> drives) {
  std::vector<DrivesOfModel> groups;
  for (const SensorDrive& drive : drives) {
    const Result<daemon::Input> input = daemon::open_replay(drive.files, drive.config);
    if (!input) return input.error();
    const std::string model = input->sensor ? input->sensor->name : drive.name;
    auto group = std::find_if(groups.begin(), groups.end(),
                              [&model](const DrivesOfModel& other) { return other.model == model; });
    if (group == groups.end()) group = groups.insert(group, DrivesOfModel{model, {}});
    group->drives.push_back(drive);
  }
  return groups;
}

class SoakSection {
 public:
  SoakSection(const SoakPlan& plan, StopSignals& signals) : plan_(plan), signals_(signals) {}

  Result<std::monostate> move(std::span<const SensorDrive> drives);
  Result<std::monostate> stay();
  [[nodiscard]] std::span<const NamedSoak> runs() const { return runs_; }

 private:
  Result<std::monostate> soak(const std::string& name, std::span<const SensorDrive> drives, double minutes,
                              bool stationary);

  const SoakPlan& plan_;
  StopSignals& signals_;
  std::vector<NamedSoak> runs_;
};

Result<std::monostate> SoakSection::soak(const std::string& name, std::span<const SensorDrive> drives,
                                         double minutes, bool stationary) {
  SoakConfig config;
  config.length = Duration::from_seconds(minutes * kMinuteS);
  config.warm_up = Duration::from_seconds(minutes * kMinuteS * plan_.warm_up_share);
  config.stationary = stationary;
  config.overrides = plan_.overrides;
  config.domain = plan_.domain;
  Result<SoakResult> result = run_soak(drives, config, signals_);
  if (!result) return Error{name + ": " + result.error().message};
  for (const std::string& note : result->notes) std::fprintf(stderr, "%s: %s\n", name.c_str(), note.c_str());
  runs_.push_back({name, std::move(result).value()});
  return std::monostate{};
}

Result<std::monostate> SoakSection::move(std::span<const SensorDrive> drives) {
  const Result<std::vector<DrivesOfModel>> groups = by_model(drives);
  if (!groups) return groups.error();
  for (const DrivesOfModel& group : *groups) {
    const std::string name = groups->size() == 1 ? "moving" : "moving, " + group.model;
    if (auto soaked = soak(name, group.drives, plan_.minutes, false); !soaked) return soaked;
  }
  return std::monostate{};
}

Result<std::monostate> SoakSection::stay() {
  const Result<fs::path> nilio = find_sibling_program("nilio");
  if (!nilio) return nilio.error();
  const Result<WorkFolder> work = WorkFolder::create();
  if (!work) return work.error();
  const std::string folder = (work->path() / "standstill").string();
  const double seconds = std::min(kStationaryLapS, plan_.stationary_minutes * kMinuteS);
  Result<ChildProcess> simulation =
      ChildProcess::start(*nilio,
                          {"simulate", folder, "--scene", "standstill", "--realism", "ideal", "--duration",
                           std::to_string(seconds)},
                          work->path() / "simulate.log");
  if (!simulation) return simulation.error();
  const auto simulated = await_end(*simulation, kSimulationLimit, signals_);
  if (!simulated) return simulated.error();
  Result<SensorDrive> drive = open_sensor_drive(folder);
  if (!drive) return drive.error();
  return soak("stationary", std::span(&*drive, 1), plan_.stationary_minutes, true);
}

}  // namespace

Result<bool> add_soak(std::span<const SensorDrive> drives, const SoakPlan& plan, StopSignals& signals,
                      ResultsPage& page) {
  page.paragraph(kLegend);
  SoakSection section(plan, signals);
  if (plan.minutes > 0.0 && !drives.empty()) {
    if (auto moved = section.move(drives); !moved) return moved.error();
  }
  if (plan.stationary_minutes > 0.0) {
    if (auto stayed = section.stay(); !stayed) return stayed.error();
  }
  page.table("Poses", soak_table(section.runs()));
  page.table("Memory", soak_memory_table(section.runs()));
  if (auto added = page.figure("memory", "Anonymous resident memory", memory_figure(section.runs()),
                               kPictureWidth, kPictureHeight);
      !added)
    return added.error();
  bool good = true;
  for (const NamedSoak& soaked : section.runs()) {
    for (const std::string& fault : find_faults(soaked.result)) {
      page.paragraph("FAIL, " + soaked.name + ": " + fault);
      good = false;
    }
  }
  if (good) page.paragraph("Soak: PASS");
  return good;
}

Result<bool> run_soak_bench(const SoakOptions& options) {
  if (options.drives.empty() && options.plan.stationary_minutes <= 0.0)
    return Error{"no drive to play - give a DRIVE, or --stationary MINUTES"};
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

}  // namespace nilio::tools::bench
