// nilio-mapper: builds submaps from the keyframes of niliod, writes them into a map folder and publishes them
// over DDS. It is a separate process at normal priority: whatever it costs, and however it ends, the odometry
// goes on.

#include "nilio/core/clock.hpp"

#include "daemon/child_process.hpp"
#include "daemon/command_line.hpp"
#include "daemon/exit_status.hpp"
#include "daemon/log_format.hpp"
#include "daemon/mapper/mapper_loop.hpp"
#include "ipc/mapper_process.hpp"

#include <cerrno>
#include <cstdint>
#include <cstring>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <memory>
#include <optional>
#include <string>
#include <unistd.h>
#include <utility>

#include <CLI/CLI.hpp>
#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>

#include "mapping/ply_file.hpp"
#include "mapping/trajectory_correction.hpp"

namespace nilio::daemon {
namespace {

/// Command line of nilio-mapper, written by ipc::MapperProcess.
struct MapperOptions {
  int keyframe_ring_descriptor = -1;
  int wake_descriptor = -1;
  int state_descriptor = -1;
  int submap_ring_descriptor = -1;
  pid_t parent = 0;
  std::string folder;
  std::string session;
  std::string trajectory;   ///< to correct; else keyframes are mapped
  std::string point_cloud;  ///< to export; else keyframes are mapped
  bool publish = true;
  MapperLoopConfig loop;
  dds::MapPublisherConfig publisher;
};

void add_options(CLI::App& app, MapperOptions& options) {
  dds::MapPublisherConfig& publisher = options.publisher;
  app.add_option("--keyframe-ring-fd", options.keyframe_ring_descriptor, "Inherited memfd of the keyframes");
  app.add_option("--wake-fd", options.wake_descriptor,
                 "Inherited eventfd, signalled when there are keyframes");
  app.add_option("--state-fd", options.state_descriptor, "Inherited memfd of this process's counters");
  app.add_option("--submap-ring-fd", options.submap_ring_descriptor,
                 "Inherited memfd that takes complete submaps; default: none");
  app.add_option("--parent-pid", options.parent, "Parent process; exit when it exits");
  app.add_option("--folder", options.folder, "Folder of the map to write; default: none");
  app.add_option("--map", options.loop.saved_map, "Folder of a saved map to localise in; only read");
  app.add_flag(
      "--continue", options.loop.continues_run,
      "--map is of a run that was killed: complete it, and tell how far from its last pose the vehicle is");
  app.add_option("--localisation-file", options.loop.localisation_file,
                 "File for the results of localisation, one line for each keyframe");
  app.add_flag("--keep-all", options.loop.keeps_all, "Localisation gets every keyframe, as in a replay");
  app.add_option("--session", options.session, "Run that writes the map; the same run continues it");
  app.add_option(
      "--trajectory", options.trajectory,
      "Only move the poses of this trajectory.tum along with the submaps of --folder, into "
      "trajectory_optimised.tum beside it, or with --localisation-file into the frame of the saved "
      "map, into trajectory_map.tum");
  app.add_option("--export", options.point_cloud, "Only write the map of --folder as this point cloud, .ply");
  app.add_option("--range", options.loop.submaps.range_m, "Maximum range of points, m")
      ->check(CLI::Range(1.0, 65.0));
  app.add_option("--max-voxels", options.loop.submaps.max_voxels, "Maximum voxels of an open submap")
      ->check(CLI::Range(std::size_t{1000}, std::size_t{2'000'000}));
  app.add_flag("!--no-loops", options.loop.closes_loops, "Do not close loops");
  app.add_flag("!--no-publish", options.publish, "Do not publish over DDS");
  app.add_option("--domain", publisher.participant.domain, "DDS domain id")->check(CLI::Range(0, 232));
  app.add_option("--interface", publisher.participant.interface_whitelist,
                 "IPv4 address of an interface for DDS (repeatable; default: all)");
  app.add_option("--map-frame", publisher.map_frame, "Frame of the map");
  app.add_option("--odom-frame", publisher.odom_frame, "Frame of the poses");
  app.add_option("--topic-prefix", publisher.topic_prefix, "Prefix of the topic names");
  app.add_option("--kept-submaps", publisher.kept_submaps, "Submaps kept for late subscribers")
      ->check(CLI::Range(1, 1000));
}

/// When memory is short, the kernel ends this process before the odometry, whose protection it inherits.
void yield_memory() { std::ofstream("/proc/self/oom_score_adj") << 500; }

core::Result<MapperInputs> attach(const MapperOptions& options) {
  auto keyframes = ipc::OverwritingRing<ipc::ScanCloud>::attach(options.keyframe_ring_descriptor);
  if (!keyframes) return keyframes.error();
  auto wake = ipc::WakeEvent::adopt(options.wake_descriptor);
  if (!wake) return wake.error();
  auto state = ipc::SharedObject<ipc::MapperState>::attach(options.state_descriptor);
  if (!state) return state.error();
  MapperInputs inputs{std::move(keyframes).value(), std::move(wake).value(), std::move(state).value(), {}};
  if (options.submap_ring_descriptor < 0) return inputs;
  auto submaps = ipc::OverwritingRing<ipc::SubmapCloud>::attach(options.submap_ring_descriptor);
  if (!submaps) return submaps.error();
  inputs.submaps.emplace(std::move(submaps).value());
  return inputs;
}

/// Null if DDS is not wanted or not possible: the map is written without it, too.
std::unique_ptr<dds::MapPublisher> make_publisher(const MapperOptions& options) {
  if (!options.publish) return nullptr;
  dds::set_fastdds_log_handler([](const std::string& line) { spdlog::warn("{}", line); });
  auto publisher = dds::MapPublisher::create(options.publisher);
  if (publisher) return std::move(publisher).value();
  spdlog::warn("the map is not published: {}", publisher.error().message);
  return nullptr;
}

int correct(const MapperOptions& options) {
  const std::filesystem::path trajectory = options.trajectory;
  if (options.folder.empty()) {
    const auto localised = mapping::localise_trajectory(options.loop.localisation_file, trajectory,
                                                        trajectory.parent_path() / "trajectory_map.tum");
    if (localised) return kDone;
    spdlog::error("{}", localised.error().message);
    return kFailed;
  }
  const auto map = mapping::MapReader::open(options.folder);
  const auto poses = map ? mapping::correct_trajectory(*map, trajectory,
                                                       trajectory.parent_path() / "trajectory_optimised.tum")
                         : core::Result<std::size_t>(map.error());
  if (poses) return kDone;
  spdlog::error("{}", poses.error().message);
  return kFailed;
}

int export_map(const MapperOptions& options) {
  const auto map = mapping::MapReader::open(options.folder);
  const auto points = map ? mapping::write_ply(*map, mapping::kRunPlySpacingMetres, options.point_cloud)
                          : core::Result<std::uint64_t>(map.error());
  if (points) return kDone;
  spdlog::error("{}", points.error().message);
  return kFailed;
}

int run(const MapperOptions& options) {
  const int signals = take_signals();
  if (signals < 0) {
    spdlog::error("signalfd: {}", std::strerror(errno));
    return kFailed;
  }
  if (!end_with_parent(options.parent)) {
    spdlog::warn("--parent-pid {}: not the parent of this process, which has ended; exiting", options.parent);
    return kFailed;
  }
  yield_memory();
  if (!options.trajectory.empty()) return correct(options);
  if (!options.point_cloud.empty()) return export_map(options);
  auto inputs = attach(options);
  if (!inputs) {
    spdlog::error("inherited descriptors: {}", inputs.error().message);
    return kFailed;
  }
  std::optional<mapping::MapWriter> writer;
  if (!options.folder.empty()) {
    auto opened =
        mapping::MapWriter::open(options.folder, options.session, core::Time{clock_ns(CLOCK_REALTIME)});
    if (!opened) {
      spdlog::error("{}", opened.error().message);
      return kFailed;
    }
    writer = std::move(opened).value();
  }
  MapperLoopConfig config = options.loop;
  config.kept_submaps = options.publisher.kept_submaps;
  MapperLoop loop(options.parent, signals, std::move(inputs).value(), std::move(writer), config,
                  make_publisher(options));
  loop.recover();
  return loop.run();
}

}  // namespace
}  // namespace nilio::daemon

int main(int argc, char** argv) {
  CLI::App app{"Builds the map of niliod. Started by niliod."};
  app.formatter(std::make_shared<nilio::HelpFormatter>());
  app.footer(nilio::exit_status_help("nilio-mapper"));
  nilio::daemon::MapperOptions options;
  options.publisher.participant.name = "nilio-mapper";
  nilio::daemon::add_options(app, options);
  if (const auto status = nilio::parse_command_line(app, argc, argv)) return *status;
  spdlog::set_default_logger(spdlog::stderr_logger_mt("nilio-mapper"));
  spdlog::set_formatter(nilio::log_formatter("nilio-mapper", STDERR_FILENO));
  return nilio::daemon::run(options);
}
