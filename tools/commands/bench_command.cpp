#include "nilio/core/odometry_config.hpp"

#include "daemon/exit_status.hpp"
#include "tools/bench/bench.hpp"
#include "tools/bench/realism/realism.hpp"
#include "tools/bench/realtime/live_run.hpp"
#include "tools/commands/command_line.hpp"
#include "tools/commands/commands.hpp"

#include <cstdio>
#include <filesystem>
#include <memory>
#include <unistd.h>

#include <CLI/CLI.hpp>

namespace nilio::tools {

namespace {

constexpr const char* kDatasets =
    "FOLDER of a recording or of a KITTI sequence, with truth.tum or poses.txt in it; or FOLDER:TRUTH";

/// --set, "key=value" of the configuration.
void add_override_option(CLI::App& command, std::vector<std::string>& overrides,
                         const std::string& description) {
  command.add_option("--set", overrides, description)->take_all()->expected(1);
}

/// --domain. The default differs between processes, and from the small numbers of other programs.
void add_domain_option(CLI::App& command, std::uint32_t& domain) {
  domain = static_cast<std::uint32_t>(100 + getpid() % 100);
  command.add_option("--domain", domain, "DDS domain id (default: one of 100 to 199)")
      ->check(number_between(0.0, 232.0));
}

/// --output, --page and --pictures.
void add_page_options(CLI::App& command, bench::ResultsPage::Options& options) {
  CLI::Option* const folder =
      command.add_option("--output", options.folder, "folder for results.md and its pictures");
  command
      .add_option_function<std::string>(
          "--page",
          [&options](const std::string& given) {
            const std::filesystem::path page = std::filesystem::absolute(given);
            options.folder = page.parent_path().string();
            options.file = page.filename().string();
          },
          "file for the page instead, with its pictures beside it")
      ->excludes(folder);
  command.add_option("--pictures", options.picture_format, "format of the pictures")
      ->check(CLI::IsMember({"svg", "png"}))
      ->capture_default_str();
}

/// --registration, with 'all' for every method.
void add_registration_option(CLI::App& command, std::vector<std::string>& registrations) {
  std::vector<std::string> names;
  for (const core::RegistrationMethod method : core::kRegistrationMethods)
    names.emplace_back(core::name_of(method));
  names.emplace_back("all");
  command.add_option("--registration", registrations, "methods to compare, or 'all'")
      ->delimiter(',')
      ->check(CLI::IsMember(names))
      ->capture_default_str();
}

/// Runs the benchmark when the command is given. Ends the parsing with CLI::RuntimeError where it fails.
template <class Options, class Run>
void on_command(CLI::App& command, std::shared_ptr<Options> options, Run run) {
  command.callback([app = &command, options, run] {
    const core::Result<bool> good = run(*options);
    if (good && *good) return;
    if (!good)
      std::fprintf(stderr, "nilio bench %s: %s\n", app->get_name().c_str(), good.error().message.c_str());
    throw CLI::RuntimeError(good ? kBadResult : kFailed);
  });
}

void add_decode(CLI::App& bench) {
  CLI::App& command = *bench.add_subcommand(
      "decode", "CPU time from packets to scans on one core: decoding, firing times, azimuths, cutting");
  const auto options = std::make_shared<bench::DecodeOptions>();
  command.add_option("capture", options->capture, "decode this capture instead of generated packets")
      ->check(CLI::ExistingFile);
  command.add_option("--rounds", options->rounds, "passes over the packets; the median counts")
      ->capture_default_str()
      ->check(number_between(1, 1000));
  command.add_option("--seconds", options->seconds, "seconds of packets in a pass")
      ->capture_default_str()
      ->check(number_between(0.1, 10.0));
  command.add_option("--missing", options->missing, "share of firings without a return")
      ->capture_default_str()
      ->check(number_between(0.0, 1.0));
  on_command(command, options, bench::run_decode_bench);
}

void add_receive(CLI::App& bench) {
  CLI::App& command = *bench.add_subcommand(
      "receive", "send numbered packets through loopback at a VLS-128's rate and account for each");
  const auto options = std::make_shared<bench::ReceiveOptions>();
  command.add_option("--speed", options->speeds, "multiples of 6,030 packets/s, one trial each")
      ->check(number_between(0.01, 100.0))
      ->capture_default_str();
  command.add_option("--seconds", options->seconds, "length of a trial")
      ->check(number_between(0.1, 3600.0))
      ->capture_default_str();
  command.add_option("--stall-ms", options->stall_ms, "sleep of the receive thread; 0 = never")
      ->check(number_between(0.0, 10000.0))
      ->capture_default_str();
  command.add_option("--stall-period-ms", options->stall_period_ms, "from one stall to the next")
      ->check(number_between(1.0, 60000.0))
      ->capture_default_str();
  command.add_option("--receive-buffer", options->receive_buffer_bytes, "socket buffer to request, bytes")
      ->check(CLI::Range(4096, 1 << 30))
      ->capture_default_str();
  command
      .add_option("--ring-slots", options->ring_slots, "packets between the receive thread and its reader")
      ->check(CLI::Range(64, 1 << 20))
      ->capture_default_str();
  on_command(command, options, bench::run_receive_bench);
}

void add_odometry(CLI::App& bench) {
  CLI::App& command =
      *bench.add_subcommand("odometry", "accuracy, time, memory and work on drives with a truth");
  const auto options = std::make_shared<bench::OdometryOptions>();
  command.add_option("datasets", options->datasets, kDatasets)->required();
  add_registration_option(command, options->registrations);
  command.add_option("--threads", options->threads, "numbers of threads to run each method with")
      ->delimiter(',')
      ->check(number_between(1, 64))
      ->capture_default_str();
  command.add_option("--repeats", options->repeats, "runs for each figure; the minimum of each scan counts")
      ->check(number_between(1, 100))
      ->capture_default_str();
  command
      .add_option_function<std::string>(
          "--vs", [options](const std::string& /*peer*/) { options->with_pcl = true; },
          "also run the Point Cloud Library's NDT and ICP on the same scans")
      ->check(CLI::IsMember({"pcl"}));
  command.add_flag("--ablation", options->ablation, "also run with one setting changed at a time");
  add_page_options(command, options->page);
  add_override_option(command, options->overrides,
                      "configuration of all runs, such as lidar.max_range_m=80; may be repeated");
  on_command(command, options, bench::run_odometry_bench);
}

void add_basin(CLI::App& bench) {
  CLI::App& command = *bench.add_subcommand("basin", "convergence basin of each registration method");
  const auto options = std::make_shared<bench::BasinOptions>();
  command.add_option("datasets", options->datasets, kDatasets)->required();
  add_registration_option(command, options->registrations);
  command.add_option("--pairs", options->pairs, "scans to try, shared among the data sets")
      ->check(number_between(1, 100000))
      ->capture_default_str();
  command.add_option("--seed", options->seed, "of the directions")->capture_default_str();
  add_override_option(command, options->overrides, "configuration, such as odometry.coarse_voxel_m=3");
  add_page_options(command, options->page);
  on_command(command, options, bench::run_basin_bench);
}

void add_matrix_run_options(CLI::App& command, bench::MatrixOptions& o) {
  CLI::Option* const quick =
      command.add_flag("--quick", o.quick, "short drives and the seeds 1 and 2: for every change");
  command
      .add_flag_callback(
          "--full", [&o] { o.quick = false; },
          "every scene, sensor, IMU and fault, which takes hours (default)")
      ->excludes(quick);
  command
      .add_flag("--effects", o.effects,
                "instead the town ideal, with each effect of 'nilio simulate --realism typical' alone, and "
                "with all: what hurts")
      ->excludes(quick);
  command.add_flag("--list", o.list, "print the names of the rows");
  command.add_option("--rows", o.rows,
                     "only rows that match a pattern of a shell, such as 'KITTI*|town*no IMU*'");
  command.add_option("--runs", o.runs, "seeds to draw for each simulated drive")
      ->check(number_between(1, 1000))
      ->capture_default_str()
      ->excludes(quick);
  CLI::Option* const seeds =
      command.add_option("--seeds", o.seeds, "these seeds instead, such as 1,2: repeats runs")
          ->delimiter(',');
  CLI::Option* const sample =
      command.add_option("--sample", o.sample, "only so many rows, which the commit draws")
          ->check(number_between(1, 100000));
  command
      .add_option("--minutes", o.minutes,
                  "end after this time with the runs done by then; drives in an order that the commit draws")
      ->check(number_between(0.1, 1e5));
  CLI::Option* const repeat =
      command
          .add_option("--repeat", o.repeat,
                      "the rows and seeds of an earlier --json, compared with it as by --baseline: the same "
                      "runs before and after a change")
          ->check(CLI::ExistingFile)
          ->excludes(seeds)
          ->excludes(sample);
  CLI::Option* const commit = command.add_option(
      "--commit", o.commit, "commit to draw the seeds from; default: that of the folder, or the version");
  command
      .add_option("--resume", o.resume,
                  "an interrupted or partial --json: its runs are kept, and the missing ones are run with "
                  "seeds of its commit, which is for the same programs")
      ->check(CLI::ExistingFile)
      ->excludes(repeat)
      ->excludes(commit);
  command.add_option("--jobs", o.jobs, "runs at the same time")
      ->check(number_between(1, 64))
      ->capture_default_str();
}

void add_matrix(CLI::App& bench) {
  CLI::App& command = *bench.add_subcommand(
      "matrix", "success, drift and silent errors over scenes, sensors, IMU and faults");
  const auto options = std::make_shared<bench::MatrixOptions>();
  command.footer(
      "The seed of a run is the first 64 bits of SHA-256(commit, drive, run number): nobody can tune to it. "
      "Rows that "
      "differ in IMU or fault share their drives. Ctrl-C keeps what is done and ends with status 130.");
  add_matrix_run_options(command, *options);
  command.add_option("--data", options->data, "folder of the real recordings (default: NILIO_DATA)")
      ->check(CLI::ExistingDirectory);
  command.add_option("--drives", options->drives,
                     "keep the drives in this folder, for peers, and use those that are there");
  command
      .add_option("--peer", options->peers,
                  "NAME=FOLDER with trajectories of another method, ROW_SEED.tum: poses of base_link; may be "
                  "repeated")
      ->take_all()
      ->expected(1);
  command
      .add_option(
          "--baseline", options->baseline,
          "earlier --json to compare with, run by run; status 3 for a new failure, a drift 1.10 times the "
          "baseline's over all rows, or twice in one row")
      ->check(CLI::ExistingFile);
  command.add_option("--json", options->json, "file for every run");
  add_page_options(command, options->page);
  add_override_option(command, options->overrides, "configuration of all runs; may be repeated");
  command.callback([options] {
    const core::Result<int> status = bench::run_matrix_bench(*options);
    if (!status) std::fprintf(stderr, "nilio bench matrix: %s\n", status.error().message.c_str());
    if (!status || *status != kDone) throw CLI::RuntimeError(status ? *status : static_cast<int>(kFailed));
  });
}

void add_realism(CLI::App& bench) {
  CLI::App& command =
      *bench.add_subcommand("realism", "simulated HDL-64E scans of the town beside a real recording");
  const auto options = std::make_shared<bench::RealismOptions>();
  command
      .add_option("recording", options->recording,
                  "KITTI's raw drive 0009 as 'nilio convert kitti-raw' writes it: FOLDER or FOLDER:TRUTH")
      ->required();
  command.add_option("--seeds", options->seeds, "these towns; default: drawn from the commit")
      ->delimiter(',');
  command.add_option("--runs", options->runs, "towns to draw, whose mean is compared")
      ->check(number_between(1, 100))
      ->capture_default_str();
  command.add_option("--commit", options->commit,
                     "commit to draw the seeds from; default: that of the folder, or the version");
  command.add_option("--effects", options->effects, "these effects of 'nilio simulate' alone, for studies")
      ->delimiter(',');
  command.add_option("--seconds", options->seconds, "length of each simulated drive")
      ->check(number_between(2.0, 600.0))
      ->capture_default_str();
  command.add_option("--every", options->every, "look at every so many scans")
      ->check(number_between(1, 100))
      ->capture_default_str();
  command.add_option("--realism", options->realism, "of the simulated drives")
      ->check(CLI::IsMember({"ideal", "typical", "poor"}))
      ->capture_default_str();
  add_page_options(command, options->page);
  on_command(command, options, bench::run_realism_bench);
}

void add_sharpness(CLI::App& bench) {
  CLI::App& command =
      *bench.add_subcommand("sharpness", "sharpness of local maps, which needs no truth, and of peers' maps");
  const auto options = std::make_shared<bench::SharpnessBenchOptions>();
  command
      .add_option("drive", options->drive,
                  "KITTI odometry sequence, or unpacked KITTI raw drive with the calibration beside it")
      ->required();
  command
      .add_option("--peer", options->peers,
                  "NAME=FILE with the poses of the LiDAR at each scan, 12 numbers a line; may be repeated")
      ->take_all()
      ->expected(1);
  command.add_option(
      "--deskew-from", options->deskew_from,
      "compensate the motion within the scans of a raw drive by this trajectory's mean motion, the "
      "same for all: the name of a peer or of a row; default: none");
  command
      .add_option("--elevation-correction", options->elevation_correction_deg,
                  "added to the elevation of all points, degrees")
      ->check(number_between(-2.0, 2.0))
      ->capture_default_str();
  command.add_option("--json", options->json, "file for the figures");
  add_override_option(command, options->overrides, "configuration of nilio's run; may be repeated");
  add_page_options(command, options->page);
  on_command(command, options, bench::run_sharpness_bench);
}

void add_soak(CLI::App& bench) {
  CLI::App& command = *bench.add_subcommand(
      "soak", "hours of drives in minutes: does the memory grow, is every pose counted");
  const auto options = std::make_shared<bench::SoakOptions>();
  command.add_option("drives", options->drives,
                     "folders of 'nilio simulate' or of recordings, or captures; each LiDAR model is played "
                     "in a loop of its own");
  command.add_option("--minutes", options->plan.minutes, "recorded time to play, in a loop")
      ->check(number_between(0.1, 1e5))
      ->capture_default_str();
  command
      .add_option("--stationary,--standing", options->plan.stationary_minutes,
                  "also simulate a vehicle at rest beside a road and play this many minutes of it")
      ->check(number_between(0.1, 1e5));
  command
      .add_option("--warm-up", options->plan.warm_up_share,
                  "share of the time before the memory is checked: the map has reached its size by then")
      ->check(number_between(0.01, 0.9))
      ->capture_default_str();
  add_domain_option(command, options->plan.domain);
  add_page_options(command, options->page);
  add_override_option(command, options->plan.overrides, "configuration of all runs; may be repeated");
  on_command(command, options, bench::run_soak_bench);
}

void add_realtime_load_options(CLI::App& command, bench::RealtimeOptions& o) {
  command.add_option("--budgets", o.budgets_ms, "odometry.budget_ms of the runs, milliseconds")
      ->delimiter(',')
      ->check(number_between(0.1, 1000.0))
      ->capture_default_str();
  // The list of names is too long for one word of the help text.
  const auto is_condition = [](const std::string& given) {
    return bench::parse_condition(given) ? std::string() : "'" + given + "' is no condition";
  };
  command
      .add_option("--conditions", o.conditions,
                  "loads and faults under the configured budget: idle, cpu, memory, subscriber, nice, "
                  "nice-later, foreign, slow-disk, full-disk (default: all)")
      ->delimiter(',')
      ->check(CLI::Validator(is_condition, "NAME"));
  command.add_flag("--conditions-only", o.conditions_only,
                   "only the conditions under the configured budget: no budgets, no identity checks");
  command.add_flag("--full", o.full, "run every budget under every condition");
  command.add_option("--seconds", o.seconds, "length of each run: the drive's beginning")
      ->check(number_between(1.0, 3600.0))
      ->capture_default_str();
  command
      .add_option("--memory-mib", o.memory_mib,
                  "maximum that condition 'memory' takes; at most nine tenths of the available memory")
      ->check(number_between(1.0, 1e6))
      ->capture_default_str();
  command
      .add_option("--soak", o.soak.minutes, "then play this many minutes of the drives, as 'bench soak' does")
      ->check(number_between(0.1, 1e5));
  command
      .add_option("--stationary,--standing", o.soak.stationary_minutes,
                  "then play this many minutes of a simulated standstill")
      ->check(number_between(0.1, 1e5));
}

void add_realtime(CLI::App& bench) {
  CLI::App& command = *bench.add_subcommand("realtime",
                                            "niliod and its publisher at the sensor's pace: budgets, loads, "
                                            "latency, identity of poses, and a soak");
  const auto options = std::make_shared<bench::RealtimeOptions>();
  bench::RealtimeOptions& o = *options;
  command.footer(
      "Each run starts niliod, found beside this program, and feeds it the drive's first seconds. The same "
      "input\n"
      "has to give the same poses over file and socket, with 1, 2 and 4 threads, idle and loaded, and from "
      "the\n"
      "decision log of an overloaded run. libnilio-watch.so counts the calls of real-time threads, where it "
      "is\n"
      "beside this program.");
  command
      .add_option("drives", o.drives,
                  "FOLDER of 'nilio simulate' or of a recording, or a capture; its truth is truth.tum in the "
                  "folder, or DRIVE:TRUTH")
      ->required();
  add_realtime_load_options(command, o);
  command
      .add_option("--feed", o.feed,
                  "udp: packets are sent to niliod's socket; replay: niliod --replay --as-live paces the "
                  "files, with the IMU")
      ->check(CLI::IsMember({"udp", "replay"}))
      ->capture_default_str();
  command.add_option("--can", o.can_interface,
                     "CAN interface (such as vcan0) to send the IMU's frames on beside UDP");
  command
      .add_option("--port", o.port,
                  "UDP port to send to, and the next for position packets (0: any free one)")
      ->check(number_between(0.0, 65534.0))
      ->capture_default_str();
  add_domain_option(command, o.soak.domain);
  add_page_options(command, o.page);
  add_override_option(command, o.overrides, "configuration of all runs; may be repeated");
  on_command(command, options, bench::run_realtime_bench);
}

}  // namespace

void add_bench_command(CLI::App& app) {
  CLI::App& bench = *app.add_subcommand("bench", "measure parts of nilio on this machine");
  bench.require_subcommand(1);
  add_basin(bench);
  add_decode(bench);
  add_odometry(bench);
  add_realism(bench);
  add_realtime(bench);
  add_receive(bench);
  add_matrix(bench);
  add_sharpness(bench);
  add_soak(bench);
}

}  // namespace nilio::tools
