#include "nilio/core/clock.hpp"

#include "tools/bench/bench.hpp"
#include "tools/bench/common/replay.hpp"
#include "tools/bench/sharpness/map_sharpness.hpp"
#include "tools/common/files.hpp"
#include "tools/common/progress.hpp"
#include "tools/common/trajectory.hpp"
#include "tools/convert/convert.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include <nlohmann/json.hpp>

namespace nilio::tools::bench {

namespace {

namespace fs = std::filesystem;
using core::Error;
using core::Result;
using Poses = std::vector<Eigen::Isometry3d>;

struct NamedPoses {
  std::string name;
  Poses poses;
};

/// Scans of a drive, and the poses that nilio gives them.
struct MeasuredDrive {
  std::vector<fs::path> scans;
  std::vector<NamedPoses> trajectories;
};

Eigen::Isometry3d lidar_pose(const core::SE3& T_odom_base, const core::SE3& T_base_lidar) {
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  const core::SE3 T_odom_lidar = T_odom_base * T_base_lidar;
  pose.linear() = T_odom_lidar.rotation.toRotationMatrix();
  pose.translation() = T_odom_lidar.translation;
  return pose;
}

Result<Replay> run_nilio(const std::string& folder, const std::vector<std::string>& overrides) {
  const auto files = daemon::find_replay_files({folder});
  if (!files) return files.error();
  const auto config = recording_config(*files, overrides);
  if (!config) return config.error();
  Progress progress("scans registered");
  std::uint64_t scans = 0;
  return replay(*files, *config, monotonic_ns, [&](const auto&...) { progress.update(++scans); });
}

/// A KITTI odometry sequence: its scans are motion-compensated, so that a scan has one pose.
Result<MeasuredDrive> open_sequence(const fs::path& folder, const std::vector<std::string>& overrides) {
  MeasuredDrive drive;
  for (const auto& entry : fs::directory_iterator(folder / "velodyne")) {
    if (entry.path().extension() == ".bin") drive.scans.push_back(entry.path());
  }
  std::sort(drive.scans.begin(), drive.scans.end());
  const auto run = run_nilio(folder.string(), overrides);
  if (!run) return run.error();
  NamedPoses own{"nilio", {}};
  for (const core::OdometryResult& result : run->results)
    own.poses.push_back(lidar_pose(result.T_odom_base, run->T_base_lidar));
  drive.trajectories.push_back(std::move(own));
  return drive;
}

/// The sweep that was being measured at `stamp`; null between sweeps.
const core::OdometryResult* sweep_at(const Replay& run, core::Time stamp) {
  const auto found = std::lower_bound(run.results.begin(), run.results.end(), stamp,
                                      [](const auto& result, core::Time t) { return result.scan_end < t; });
  return found != run.results.end() && found->scan_start <= stamp ? &*found : nullptr;
}

/// A KITTI raw drive, replayed from the packets that its scans were made of. A scan has the poses of the
/// sweep that its middle lies in; the first and last may have none and are left out.
Result<MeasuredDrive> open_raw_drive(const fs::path& folder, const std::vector<std::string>& overrides) {
  const auto work = WorkFolder::create();
  if (!work) return work.error();
  const fs::path packets = work->path() / "drive";
  const auto converted = convert::convert_kitti_raw({folder.string(), packets.string(), ""});
  if (!converted) return converted.error();
  const auto raw = convert::read_kitti_raw(folder, folder);
  if (!raw) return raw.error();
  const auto run = run_nilio(packets.string(), overrides);
  if (!run) return run.error();
  MeasuredDrive drive;
  NamedPoses middles{"nilio, middle of the sweep", {}};
  NamedPoses ends{"nilio, end of the sweep", {}};
  for (const convert::KittiRawScan& scan : raw->scans) {
    const core::OdometryResult* const sweep =
        sweep_at(*run, scan.start + core::Duration{(scan.end - scan.start).ns / 2});
    if (sweep == nullptr && drive.scans.empty())
      return Error{scan.path.string() +
                   ": nilio has no pose for the first scan, so that poses of peers would not match"};
    if (sweep == nullptr) break;
    drive.scans.push_back(scan.path);
    middles.poses.push_back(lidar_pose(sweep->T_odom_base_middle, run->T_base_lidar));
    ends.poses.push_back(lidar_pose(sweep->T_odom_base, run->T_base_lidar));
  }
  drive.trajectories.push_back(std::move(middles));
  drive.trajectories.push_back(std::move(ends));
  return drive;
}

Result<MeasuredDrive> open_drive(const std::string& folder, const std::vector<std::string>& overrides) {
  const fs::path path(folder);
  if (fs::is_directory(path / "velodyne_points")) return open_raw_drive(path, overrides);
  if (fs::is_directory(path / "velodyne")) return open_sequence(path, overrides);
  return Error{folder +
               ": is neither a KITTI odometry sequence (velodyne/) nor a raw drive (velodyne_points/)"};
}

/// "NAME=FILE".
Result<NamedPoses> read_peer(const std::string& argument, std::size_t scans) {
  const std::size_t equals = argument.find('=');
  if (equals == std::string::npos || equals == 0) return Error{"--peer " + argument + ": needs NAME=FILE"};
  const std::string path = argument.substr(equals + 1);
  auto trajectory = read_trajectory(path);
  if (!trajectory) return trajectory.error();
  if (trajectory->format != TrajectoryFormat::kKitti)
    return Error{path + ": needs one line of 12 numbers for each scan (KITTI), the pose of the LiDAR"};
  if (trajectory->poses.size() < scans)
    return Error{path + ": has " + std::to_string(trajectory->poses.size()) + " poses for " +
                 std::to_string(scans) + " scans"};
  return NamedPoses{argument.substr(0, equals), std::move(trajectory->poses)};
}

Result<std::vector<Cloud>> load_clouds(const MeasuredDrive& drive, double elevation_correction_deg,
                                       const Poses* deskew_poses) {
  std::vector<Cloud> clouds;
  for (std::size_t i = 0; i < drive.scans.size(); ++i) {
    const auto points = convert::read_kitti_scan(drive.scans[i]);
    if (!points) return points.error();
    Cloud cloud;
    for (const convert::KittiPoint& p : *points) cloud.emplace_back(p.x, p.y, p.z);
    if (deskew_poses != nullptr) cloud = compensate(std::move(cloud), mean_motion(*deskew_poses, i));
    clouds.push_back(prepare_scan(std::move(cloud), elevation_correction_deg));
  }
  return clouds;
}

/// Null for no name.
Result<const Poses*> find_poses(const std::vector<NamedPoses>& all, const std::string& name) {
  if (name.empty()) return static_cast<const Poses*>(nullptr);
  std::string names;
  for (const NamedPoses& candidate : all) {
    if (candidate.name == name) return &candidate.poses;
    names += (names.empty() ? "'" : ", '") + candidate.name + "'";
  }
  return Error{"--deskew-from " + name + ": is none of " + names};
}

Table sharpness_table(const std::vector<NamedPoses>& names, const std::vector<Sharpness>& figures) {
  Table table{{"trajectory", "shift mm: median", "rms", "thickness mm: median", "quartile", "entropy nat",
               "coverage", "anchors"},
              {}};
  for (std::size_t k = 0; k < figures.size(); ++k) {
    const Sharpness& f = figures[k];
    table.rows.push_back({names[k].name, fixed(f.shift_median_mm, 2), fixed(f.shift_rms_mm, 2),
                          fixed(f.thickness_median_mm, 2), fixed(f.thickness_quartile_mm, 2),
                          fixed(f.entropy, 4), fixed(f.coverage, 3), std::to_string(f.anchors)});
  }
  return table;
}

Result<std::monostate> write_json(const std::string& path, const std::vector<NamedPoses>& names,
                                  const std::vector<Sharpness>& figures) {
  nlohmann::ordered_json rows = nlohmann::ordered_json::array();
  for (std::size_t k = 0; k < figures.size(); ++k) {
    const Sharpness& f = figures[k];
    rows.push_back({{"trajectory", names[k].name},
                    {"shift_median_mm", f.shift_median_mm},
                    {"shift_rms_mm", f.shift_rms_mm},
                    {"thickness_median_mm", f.thickness_median_mm},
                    {"thickness_quartile_mm", f.thickness_quartile_mm},
                    {"entropy", f.entropy},
                    {"coverage", f.coverage},
                    {"anchors", f.anchors},
                    {"windows", f.windows}});
  }
  return write_text(path, rows.dump(2) + '\n');
}

}  // namespace

Result<bool> run_sharpness_bench(const SharpnessBenchOptions& options) {
  Result<MeasuredDrive> drive = open_drive(options.drive, options.overrides);
  if (!drive) return drive.error();
  for (const std::string& argument : options.peers) {
    auto peer = read_peer(argument, drive->scans.size());
    if (!peer) return peer.error();
    drive->trajectories.push_back(std::move(peer).value());
  }
  const auto deskew_poses = find_poses(drive->trajectories, options.deskew_from);
  if (!deskew_poses) return deskew_poses.error();
  const auto clouds = load_clouds(*drive, options.elevation_correction_deg, *deskew_poses);
  if (!clouds) return clouds.error();
  std::vector<Poses> poses;
  for (const NamedPoses& named : drive->trajectories) poses.push_back(named.poses);
  const std::vector<Sharpness> figures = measure_sharpness(*clouds, poses, {});
  if (figures.empty())
    return Error{options.drive + ": has " + std::to_string(clouds->size()) +
                 " scans with a pose, 20 are needed"};
  Result<ResultsPage> page = ResultsPage::create(options.page, "Map sharpness without truth");
  if (!page) return page.error();
  page->paragraph(
      "Local maps of two seconds, the same clouds and anchors for every trajectory. Shift: spread of single "
      "scans' "
      "offsets from the common plane of an anchor. Thickness: of the points at an anchor. Coverage: share of "
      "the "
      "anchors with enough neighbours; figures compare only where it agrees. Blind to drift beyond two "
      "seconds.");
  const std::size_t windows = figures.front().windows;
  page->table(fs::path(options.drive).filename().string() + ": " + std::to_string(clouds->size()) +
                  " scans, " + std::to_string(windows) + " windows",
              sharpness_table(drive->trajectories, figures));
  if (!options.json.empty()) {
    if (auto written = write_json(options.json, drive->trajectories, figures); !written)
      return written.error();
  }
  if (const auto saved = page->save(); !saved) return saved.error();
  return true;
}

}  // namespace nilio::tools::bench
