#include "nilio/core/clock.hpp"

#include "daemon/exit_status.hpp"
#include "tools/commands/command_line.hpp"
#include "tools/commands/commands.hpp"
#include "tools/common/files.hpp"
#include "tools/map/close.hpp"
#include "tools/map/edit.hpp"
#include "tools/map/export.hpp"
#include "tools/map/gnss.hpp"
#include "tools/map/render.hpp"

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <system_error>
#include <vector>

#include <CLI/CLI.hpp>

#include "mapping/map_recovery.hpp"
#include "mapping/ply_file.hpp"
#include "mapping/trajectory_correction.hpp"

namespace nilio::tools {

namespace {

using core::Error;
using core::Result;
using mapping::MapReader;

int report(const Result<std::monostate>& done) {
  if (done) return kDone;
  std::cerr << "nilio map: " << done.error().message << '\n';
  return kFailed;
}

/// The folder itself, or the map in it if it is an output folder of niliod.
std::filesystem::path map_folder(const std::filesystem::path& folder) {
  std::error_code error;
  const bool is_run = !std::filesystem::exists(folder / "map.log", error) &&
                      std::filesystem::exists(folder / "map/map.log", error);
  return is_run ? folder / "map" : folder;
}

Result<MapReader> open_map(const std::string& folder) {
  auto map = MapReader::open(map_folder(folder));
  if (map && !map->warning().empty()) std::cerr << "nilio map: " << map->warning() << '\n';
  return map;
}

void print_datum(const mapping::MapGnss& gnss) {
  using mapping::AltitudeReference;
  const mapping::Datum& datum = gnss.datum;
  std::printf("origin         %.9f, %.9f, ", datum.latitude_deg, datum.longitude_deg);
  if (gnss.altitude == AltitudeReference::kNone)
    std::printf("no altitude");
  else
    std::printf("%.2f m above %s", datum.altitude_m,
                gnss.altitude == AltitudeReference::kSeaLevel ? "mean sea level" : "the WGS 84 ellipsoid");
  std::printf("; x axis %.4f deg from north\n", datum.heading_deg);
}

Result<std::monostate> print_info(const std::string& folder) {
  const auto map = open_map(folder);
  if (!map) return map.error();
  const auto summary = map::summarise(*map);
  if (!summary) return summary.error();
  const map::MapSummary& s = *summary;
  const double km = s.path_m * 1e-3;
  std::printf("map            ");
  for (const std::uint8_t byte : map->header().id) std::printf("%02x", byte);
  std::printf("\nsubmaps        %zu\nkeyframes      %zu over %.1f m, %.1f s\nsurfaces       %zu\n", s.submaps,
              s.keyframes, s.path_m, static_cast<double>(s.last.ns - s.first.ns) * 1e-9, s.surfaces);
  if (const std::size_t open = mapping::OpenKeyframes(map_folder(folder)).count(); open > 0)
    std::printf("open           %zu keyframes; nilio map recover adds them if their run has been killed\n",
                open);
  if (map->gnss()) print_datum(*map->gnss());
  if (!map->loops().empty())
    std::printf("loops          %td\n",
                std::count_if(map->loops().begin(), map->loops().end(), [](const mapping::Loop& loop) {
                  return loop.verdict == mapping::LoopVerdict::kAccepted;
                }));
  std::printf("size           %.2f MB", s.megabytes);
  if (km > 0.1) std::printf(", %.2f MB/km", s.megabytes / km);
  std::printf("\n");
  if (s.surfaces > 0)
    std::printf("extent         x %.1f to %.1f, y %.1f to %.1f, z %.1f to %.1f m\n", s.bounds.minimum.x(),
                s.bounds.maximum.x(), s.bounds.minimum.y(), s.bounds.maximum.y(), s.bounds.minimum.z(),
                s.bounds.maximum.z());
  return std::monostate{};
}

struct Paths {
  std::string map;
  std::string output;
};

struct ExportOptions {
  Paths paths;
  double spacing_m = 0.0;
  std::optional<gnss::GeodeticOrigin> origin;
};

Result<std::monostate> export_map(const ExportOptions& options) {
  const std::string& output = options.paths.output;
  const bool is_path = map::is_path_file(output);
  if (const auto format = map::format_of(output); !format && !is_path) return format.error();
  if (options.origin && (!is_path || output.ends_with(".tum")))
    return Error{output + ": only .geojson and .kml have an origin - leave --origin out"};
  if (is_path && options.spacing_m > 0.0) return Error{output + ": a path has no --spacing - leave it out"};
  const auto map = open_map(options.paths.map);
  if (!map) return map.error();
  if (is_path) {
    const auto path = map::read_path(*map);
    if (!path) return path.error();
    const auto origin = !options.origin && map->gnss() ? map::origin_of(map->gnss()->datum) : options.origin;
    const auto written = map::write_path(*path, origin, output);
    if (written) std::printf("%s: %zu poses\n", output.c_str(), path->poses.size());
    return written;
  }
  const auto points = map::export_map(*map, options.spacing_m, output);
  if (!points) return points.error();
  std::printf("%s: %llu points\n", output.c_str(), static_cast<unsigned long long>(*points));
  return std::monostate{};
}

/// Writes map.ply beside a map with trajectory.tum, the output folder of niliod.
Result<std::monostate> export_run(const MapReader& map, const std::filesystem::path& run) {
  std::error_code error;
  if (!std::filesystem::exists(run / "trajectory.tum", error)) return std::monostate{};
  const std::string output = run / "map.ply";
  const auto points = map::export_map(map, mapping::kRunPlySpacingMetres, output);
  if (!points) return points.error();
  std::printf("%s: %llu points\n", output.c_str(), static_cast<unsigned long long>(*points));
  return std::monostate{};
}

Result<std::monostate> recover_map(const std::string& folder) {
  const std::filesystem::path path = map_folder(folder);
  const auto keyframes = mapping::recover_map(path, {nilio::clock_ns(CLOCK_REALTIME)});
  if (!keyframes) return keyframes.error();
  std::printf("%zu keyframes of open submaps\n", *keyframes);
  const auto map = open_map(folder);
  return map ? export_run(*map, path.parent_path()) : map.error();
}

struct CloseOptions {
  std::string folder;
  std::string json;
  std::string gnss;
  std::string gnss_topic;
  gnss::GeoreferenceOptions georeference;
};

Result<std::monostate> close_map(const CloseOptions& options) {
  const std::string& folder = options.folder;
  std::optional<map::GnssInput> gnss;
  if (!options.gnss.empty()) {
    auto track = gnss::read_track(options.gnss, options.gnss_topic);
    if (!track) return track.error();
    for (const std::string& note : track->notes) std::printf("gnss           %s\n", note.c_str());
    gnss = {std::move(track).value(), options.georeference};
  }
  const auto closed = map::close(map_folder(folder), gnss);
  if (!closed) return closed.error();
  std::map<std::string, std::size_t> refused;
  std::size_t accepted = 0;
  for (const map::ClosedLoop& loop : closed->loops) {
    if (loop.loop.verdict == mapping::LoopVerdict::kAccepted) {
      ++accepted;
      std::printf("loop           submap %u to %u, overlap %.0f %%\n", loop.loop.moving, loop.loop.reference,
                  100.0 * loop.loop.alignment.overlap);
    } else {
      ++refused[mapping::verdict_name(loop.loop.verdict)];
    }
  }
  std::printf("submaps        %zu, %zu loops, poses moved by up to %.3f m\n", closed->ids.size(), accepted,
              closed->largest_correction_m);
  for (const auto& [reason, count] : refused) std::printf("refused        %zu %s\n", count, reason.c_str());
  std::printf("time           %.2f s, at most %.2f s for a submap\n", closed->seconds,
              closed->longest_submap_s);
  if (closed->gnss) {
    const auto& positions = closed->gnss->positions;
    const auto used =
        std::count_if(positions.begin(), positions.end(), [](const auto& p) { return p.is_inlier; });
    if (!positions.empty())
      std::printf(
          "gnss           %td of %zu positions used, %.2f m from the map (root mean square, horizontal)\n",
          used, positions.size(), closed->gnss_rms_m);
    print_datum(*closed->gnss);
  }
  if (!options.json.empty()) {
    if (auto written = write_text(options.json, map::loops_json(*closed)); !written) return written;
  }
  // The trajectory of the run beside its map.
  const std::filesystem::path run = map_folder(folder).parent_path();
  std::error_code error;
  if (!std::filesystem::exists(run / "trajectory.tum", error)) return std::monostate{};
  const auto map = MapReader::open(map_folder(folder));
  if (!map) return map.error();
  const std::filesystem::path output = run / "trajectory_optimised.tum";
  const auto poses = mapping::correct_trajectory(*map, run / "trajectory.tum", output);
  if (!poses) return poses.error();
  std::printf("%s: %zu poses\n", output.c_str(), *poses);
  return export_run(*map, run);
}

Result<std::monostate> render_map(const Paths& options, const map::RenderOptions& render) {
  const auto map = open_map(options.map);
  if (!map) return map.error();
  const auto cloud = map::read_cloud(*map);
  if (!cloud) return cloud.error();
  const auto path = map::read_path(*map);
  if (!path) return path.error();
  const auto written = map::render_png(*cloud, *path, render, options.output);
  if (!written) return written.error();
  return std::monostate{};
}

Result<std::monostate> crop_map(const Paths& options, const std::vector<double>& low,
                                const std::vector<double>& high) {
  const auto map = open_map(options.map);
  if (!map) return map.error();
  return map::crop(*map, {core::Vector3(low.data()), core::Vector3(high.data())}, options.output);
}

Result<std::monostate> merge_maps(const std::vector<std::string>& folders, const std::string& output) {
  std::vector<MapReader> maps;
  for (const std::string& folder : folders) {
    auto map = open_map(folder);
    if (!map) return map.error();
    maps.push_back(std::move(map).value());
  }
  return map::merge(maps, output);
}

Result<std::monostate> diff_maps(const std::vector<std::string>& folders, double reach_m,
                                 const std::string& output) {
  const auto first = open_map(folders[0]);
  if (!first) return first.error();
  const auto second = open_map(folders[1]);
  if (!second) return second.error();
  const auto difference = map::diff(*first, *second, reach_m);
  if (!difference) return difference.error();
  std::printf("in both        %zu surfaces, %.1f mm apart along their normals (root mean square)\n",
              difference->both, 1e3 * difference->distance_rms_m);
  std::printf("only first     %zu\nonly second    %zu\n", difference->only_first, difference->only_second);
  return output.empty() ? Result<std::monostate>(std::monostate{})
                        : map::write_cloud(difference->changes, output);
}

void add_export(CLI::App& parent, int& status) {
  const auto options = std::make_shared<ExportOptions>();
  CLI::App* const command =
      parent.add_subcommand("export", "the surfaces of a map as a point cloud, or the path of the drive");
  command->footer(
      "One point for each voxel of 0.5 m (planes) or 1 m (irregular surfaces), in the map frame, in metres, "
      "with its normal, mean intensity (0 to 255; LAS: times 257) and the time at which it was seen last. "
      "PLY: grey colours of the intensity; PCD: fields of pcl::PointXYZINormal, curvature is the thickness "
      "in metres; LAS 1.4: point format 6, normals as extra bytes, no coordinate system. Path: poses of the "
      "keyframes in the format of TUM, or a line of GeoJSON or KML in WGS 84.");
  command->add_option("map", options->paths.map, "folder of the map")->required();
  command->add_option("output", options->paths.output, "file: .ply, .pcd, .las; .tum, .geojson, .kml")
      ->required();
  command
      ->add_option("--spacing", options->spacing_m,
                   "fill the voxels of planes with points at this distance, m (default: one point each)")
      ->check(number_between(0.02, 0.25));
  add_origin_option(*command, options->origin,
                    ".geojson, .kml: place of the map's origin (default: that by GNSS)");
  command->callback([options, &status] { status = report(export_map(*options)); });
}

void add_render(CLI::App& parent, int& status) {
  const auto paths = std::make_shared<Paths>();
  const auto options = std::make_shared<map::RenderOptions>();
  CLI::App* const command = parent.add_subcommand("render", "a picture of a map, with the path of the drive");
  command->add_option("map", paths->map, "folder of the map")->required();
  command->add_option("output", paths->output, "picture, .png")->required();
  command->add_option("--view", options->view, "top (default) or oblique")
      ->transform(choice_of<map::View>({{"top", map::View::kTop}, {"oblique", map::View::kOblique}}));
  command->add_option("--colour", options->shading, "height (default) or intensity")
      ->transform(choice_of<map::Shading>(
          {{"height", map::Shading::kHeight}, {"intensity", map::Shading::kIntensity}}));
  command->add_option("--width", options->width_px, "pixels")
      ->check(number_between(100, 8000))
      ->capture_default_str();
  command->callback([paths, options, &status] { status = report(render_map(*paths, *options)); });
}

void add_close(CLI::App& parent, int& status) {
  const auto options = std::make_shared<CloseOptions>();
  CLI::App* const command = parent.add_subcommand(
      "close", "closes the loops of a map: poses of the submaps that agree where the drive returns");
  command->footer(
      "The poses are written into the map, and all commands use them; the submaps and the odometry stay as "
      "they are, so that it can be repeated. Positions of GNSS stay in the map until its file poses is "
      "removed. Beside a map with trajectory.tum, the output folder of niliod, "
      "trajectory_optimised.tum and map.ply get the same correction.");
  command->add_option("map", options->folder, "folder of the map, or output folder of niliod")->required();
  command->add_option("--json", options->json, "all candidates with the figures of their checks, .json");
  command->add_option("--gnss", options->gnss,
                      "ROS bag, capture or CSV file with GNSS positions: the map follows them, and gets its "
                      "place on the earth");
  command->add_option("--gnss-topic", options->gnss_topic, "topic of a bag with several topics of positions")
      ->needs("--gnss");
  add_georeference_options(*command, options->georeference);
  for (const char* const name : {"--antenna", "--time-offset"}) command->get_option(name)->needs("--gnss");
  command->callback([=, &status] { status = report(close_map(*options)); });
}

void add_edits(CLI::App& parent, int& status) {
  const auto paths = std::make_shared<Paths>();
  const auto low = std::make_shared<std::vector<double>>();
  const auto high = std::make_shared<std::vector<double>>();
  CLI::App* const crop = parent.add_subcommand("crop", "the part of a map inside a box, as a new map");
  crop->add_option("map", paths->map, "folder of the map")->required();
  crop->add_option("output", paths->output, "folder of the new map")->required();
  crop->add_option("--min", *low, "lowest corner of the box: x y z, metres")->expected(3)->required();
  crop->add_option("--max", *high, "highest corner of the box: x y z, metres")->expected(3)->required();
  crop->callback([=, &status] { status = report(crop_map(*paths, *low, *high)); });

  const auto broken = std::make_shared<std::string>();
  CLI::App* const recover = parent.add_subcommand(
      "recover", "completes a map whose run was killed, with the keyframes of its open submaps");
  recover->add_option("map", *broken, "folder of the map")->required();
  recover->callback([broken, &status] { status = report(recover_map(*broken)); });

  const auto folders = std::make_shared<std::vector<std::string>>();
  const auto merged = std::make_shared<std::string>();
  CLI::App* const merge = parent.add_subcommand("merge", "several maps of the same frame as one new map");
  merge->footer(
      "The maps are not aligned with each other: they have to share their map frame, such as parts of one "
      "map.");
  merge->add_option("maps", *folders, "folders of the maps")->required()->expected(1, -1);
  merge->add_option("--output", *merged, "folder of the new map")->required();
  merge->callback([=, &status] { status = report(merge_maps(*folders, *merged)); });

  const auto pair = std::make_shared<std::vector<std::string>>();
  const auto changes = std::make_shared<std::string>();
  const auto reach = std::make_shared<double>(25.0);
  CLI::App* const diff = parent.add_subcommand("diff", "differences between two maps of the same frame");
  diff->footer(
      "Only places near both paths are compared. In the file of --output, intensity 0 marks surfaces of the "
      "first map only, 255 of the second only.");
  diff->add_option("maps", *pair, "folders of the two maps")->required()->expected(2);
  diff->add_option("--reach", *reach, "maximum distance from both paths, m")
      ->check(number_between(1, 200))
      ->capture_default_str();
  diff->add_option("--output", *changes, "surfaces of one map only: .ply, .pcd or .las");
  diff->callback([=, &status] { status = report(diff_maps(*pair, *reach, *changes)); });
}

}  // namespace

void add_map_command(CLI::App& app, int& status) {
  CLI::App* const command =
      app.add_subcommand("map", "maps of niliod: information, point clouds, pictures, edits");
  command->require_subcommand(1);
  const auto folder = std::make_shared<std::string>();
  CLI::App* const info =
      command->add_subcommand("info", "submaps, path, extent and size of a map; checks every file");
  info->add_option("map", *folder, "folder of the map, or output folder of niliod")->required();
  info->callback([folder, &status] { status = report(print_info(*folder)); });

  add_export(*command, status);
  add_render(*command, status);
  add_close(*command, status);
  add_edits(*command, status);
}

}  // namespace nilio::tools
