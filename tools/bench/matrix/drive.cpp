#include "tools/bench/matrix/drive.hpp"

#include "daemon/output/sha256.hpp"
#include "tools/common/child_process.hpp"
#include "tools/common/system.hpp"
#include "tools/common/trajectory.hpp"
#include "tools/convert/kitti_raw.hpp"

#include <algorithm>
#include <fstream>
#include <system_error>
#include <utility>

namespace nilio::tools::bench {

namespace {

namespace fs = std::filesystem;
using core::Duration;
using core::Error;
using core::Result;

constexpr Duration kProcessPatience = Duration::from_milliseconds(2000.0);
constexpr const char* kArchive04 = "kitti/odometry_04_frames_000-050.tar.xz";
constexpr const char* kPoses = "kitti/odometry_poses_00-10.tar.xz";
constexpr const char* kArchive0009 = "kitti/raw_2011_09_26_drive_0009_scans_00-50.tar.xz";
// Reference of the raw drive: eight methods agree on it within 0.14 %, its own receiver differs by 2.7 %.
constexpr const char* kReference0009 = "kitti/peer_trajectories/raw0009.vgicp_model.txt";

Result<std::monostate> run_process(const fs::path& program, const std::vector<std::string>& arguments,
                                   const fs::path& log, const std::atomic<bool>& stop) {
  auto process = ChildProcess::start(program, arguments, log);
  if (!process) return process.error();
  while (true) {
    const std::optional<int> status = process->poll();
    if (status == 0) return std::monostate{};
    if (status)
      return Error{program.filename().string() + " " + arguments.front() + ": status " +
                   std::to_string(*status) + ": " + process->last_line()};
    if (stop) {
      process->stop(kProcessPatience);
      return Error{"stopped"};
    }
    sleep_for(kPoll);
  }
}

/// The first file or folder of that name below `folder`.
Result<fs::path> find_below(const fs::path& folder, const std::string& name) {
  std::error_code error;
  for (const auto& entry : fs::recursive_directory_iterator(folder, error)) {
    if (entry.path().filename() == name) return entry.path();
  }
  return Error{folder.string() + ": has no " + name + " - the archive is another one than expected"};
}

Result<std::monostate> unpack(const fs::path& archive, const fs::path& folder,
                              const std::atomic<bool>& stop) {
  fs::create_directories(folder);
  return run_process("/bin/tar", {"-xJf", archive.string(), "-C", folder.string()}, folder / "tar.log", stop);
}

Result<std::monostate> write_tum(Trajectory trajectory, const fs::path& path) {
  trajectory.format = TrajectoryFormat::kTum;
  const auto written = write_trajectory(trajectory, path.string());
  if (!written) return written.error();
  return std::monostate{};
}

/// truth.tum of a sequence: the LiDAR, which is base_link, at the times of its scans.
Result<std::monostate> write_sequence_truth(const fs::path& poses_file, const fs::path& sequence) {
  const auto poses = read_trajectory(poses_file.string());
  if (!poses) return poses.error();
  const auto T_camera_lidar = read_kitti_calibration((sequence / "calib.txt").string());
  if (!T_camera_lidar) return T_camera_lidar.error();
  std::ifstream times(sequence / "times.txt");
  Trajectory truth;
  double seconds = 0.0;
  for (const Pose& pose : poses->poses) {
    if (!(times >> seconds)) break;
    truth.stamps.push_back(core::Time::from_seconds(seconds));
    truth.poses.push_back(T_camera_lidar->inverse() * pose * *T_camera_lidar);
  }
  return write_tum(std::move(truth), sequence / "truth.tum");
}

Result<std::monostate> make_kitti04(const DriveSources& sources, const fs::path& folder,
                                    const std::atomic<bool>& stop) {
  const fs::path work = folder.string() + ".work";
  if (auto done = unpack(sources.data / kArchive04, work, stop); !done) return done;
  if (auto done = unpack(sources.data / kPoses, work / "all_poses", stop); !done) return done;
  const auto scans = find_below(work, "velodyne");
  if (!scans) return scans.error();
  const auto poses = find_below(work / "all_poses", "04.txt");
  if (!poses) return poses.error();
  fs::rename(scans->parent_path(), folder);
  auto written = write_sequence_truth(*poses, folder);
  fs::remove_all(work);
  return written;
}

Result<std::monostate> write_raw_truth(const fs::path& raw, const fs::path& reference, const fs::path& path) {
  auto poses = read_trajectory(reference.string());
  if (!poses) return poses.error();
  const auto stamps = convert::read_kitti_stamps(raw / "velodyne_points" / "timestamps.txt");
  if (!stamps) return stamps.error();
  Trajectory truth;
  for (std::size_t i = 0; i < std::min(poses->poses.size(), stamps->size()); ++i) {
    if (!(*stamps)[i]) continue;
    truth.stamps.push_back(*(*stamps)[i]);
    truth.poses.push_back(poses->poses[i]);
  }
  return write_tum(std::move(truth), path);
}

Result<std::monostate> make_raw0009(const DriveSources& sources, const fs::path& folder,
                                    const std::atomic<bool>& stop) {
  const fs::path work = folder.string() + ".work";
  if (auto done = unpack(sources.data / kArchive0009, work, stop); !done) return done;
  const auto scans = find_below(work, "velodyne_points");
  if (!scans) return scans.error();
  const fs::path raw = scans->parent_path();
  auto done = run_process(sources.nilio, {"convert", "kitti-raw", raw.string(), folder.string()},
                          work / "convert.log", stop);
  if (done) done = write_raw_truth(raw, sources.data / kReference0009, folder / "truth.tum");
  fs::remove_all(work);
  return done;
}

Result<std::monostate> make_simulated(const DriveSpec& drive, std::uint64_t seed, const DriveSources& sources,
                                      const fs::path& folder, const std::atomic<bool>& stop) {
  std::vector<std::string> arguments{"simulate", folder.string()};
  arguments.insert(arguments.end(), drive.options.begin(), drive.options.end());
  arguments.insert(arguments.end(), {"--seed", std::to_string(seed)});
  return run_process(sources.nilio, arguments, folder.string() + ".log", stop);
}

}  // namespace

bool is_available(const DriveSpec& drive, const DriveSources& sources) {
  if (drive.kind == DriveKind::kSimulated) return true;
  if (sources.data.empty()) return false;
  std::error_code ignored;
  if (drive.kind == DriveKind::kKitti04)
    return fs::exists(sources.data / kArchive04, ignored) && fs::exists(sources.data / kPoses, ignored);
  return fs::exists(sources.data / kArchive0009, ignored) &&
         fs::exists(sources.data / kReference0009, ignored);
}

Result<std::monostate> make_drive(const DriveSpec& drive, std::uint64_t seed, const DriveSources& sources,
                                  const fs::path& folder, const std::atomic<bool>& stop) {
  switch (drive.kind) {
    case DriveKind::kKitti04:
      return make_kitti04(sources, folder, stop);
    case DriveKind::kKittiRaw0009:
      return make_raw0009(sources, folder, stop);
    case DriveKind::kSimulated:
      break;
  }
  return make_simulated(drive, seed, sources, folder, stop);
}

Result<std::string> hash_drive(const fs::path& folder) {
  std::vector<fs::path> files;
  std::error_code error;
  for (const auto& entry : fs::recursive_directory_iterator(folder, error)) {
    if (entry.is_regular_file()) files.push_back(entry.path());
  }
  if (error) return Error{folder.string() + ": cannot be read (" + error.message() + ")"};
  std::sort(files.begin(), files.end());
  daemon::Sha256 hash;
  for (const fs::path& file : files) {
    hash.add(fs::relative(file, folder).string());
    if (const auto added = hash.add_file(file); !added) return added.error();
  }
  return hash.hex();
}

}  // namespace nilio::tools::bench
