#include "daemon/output/run_output.hpp"

#include "nilio/core/compute_budget.hpp"
#include "nilio/core/tracking.hpp"
#include "nilio/core/units.hpp"

#include "ipc/histogram.hpp"

#include <array>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <span>
#include <string_view>
#include <utility>
#include <vector>

namespace nilio::daemon {

namespace {

namespace fs = std::filesystem;
using core::Error;
using core::Result;

Error cannot_write(const fs::path& path) {
  return Error{path.string() +
               ": cannot be written: check that the folder exists, is writable and the disk is not full"};
}

core::SE3 pose_of(const ipc::PoseRecord& record) {
  return {core::from_xyzw(record.orientation_xyzw), core::Vector3(record.position.data())};
}

std::string kitti_line(const core::SE3& pose) {
  const Eigen::Matrix4d m = pose.matrix();
  std::string line;
  for (int i = 0; i < 12; ++i) {
    char number[40];
    std::snprintf(number, sizeof number, "%.9e%c", m(i / 4, i % 4), i == 11 ? '\n' : ' ');
    line += number;
  }
  return line;
}

std::string tum_line(std::int64_t stamp_ns, const std::array<double, 3>& p, const std::array<double, 4>& q) {
  char line[256];
  std::snprintf(line, sizeof line, "%lld.%09lld %.9f %.9f %.9f %.9f %.9f %.9f %.9f\n",
                static_cast<long long>(stamp_ns / kNanosecondsPerSecond),
                static_cast<long long>(stamp_ns % kNanosecondsPerSecond), p[0], p[1], p[2], q[0], q[1], q[2],
                q[3]);
  return line;
}

/// Duration between two stages as a cell, empty where one of them is unknown.
std::string duration_cell(std::int64_t begin_ns, std::int64_t end_ns) {
  if (begin_ns == 0 || end_ns == 0) return ",";
  std::array<char, 32> cell{};
  std::snprintf(cell.data(), cell.size(), ",%.1f", static_cast<double>(end_ns - begin_ns) * 1e-3);
  return cell.data();
}

/// First line of scans.csv: the names of the columns.
std::string scan_table_header() {
  std::string header =
      "scan,stamp_s,state,stop_reason,degradation_level,degenerate_axes,time_source,imu_used,predicted,"
      "guarded,"
      "speed_m_s,points,points_used,correspondences,coarse_iterations,fine_iterations,map_voxels,lost_"
      "packets,"
      "missing_firings,superseded,overshoot_us";
  for (const std::string_view stage : ipc::kLatencyStageNames) header += "," + std::string(stage) + "_us";
  return header + '\n';
}

/// Line of scans.csv for a scan: state, counters, speed, and the duration of each stage in microseconds,
/// empty where it is unknown.
std::string scan_table_line(const ipc::PoseRecord& r) {
  std::array<char, 512> cells{};
  const auto& v = r.linear_velocity;
  std::snprintf(cells.data(), cells.size(),
                "%llu,%lld.%09lld,%s,%s,%s,%u,%s,%d,%d,%d,%.4f,%u,%u,%u,%u,%u,%u,%u,%u,%llu",
                static_cast<unsigned long long>(r.sequence),
                static_cast<long long>(r.stamp_ns / kNanosecondsPerSecond),
                static_cast<long long>(r.stamp_ns % kNanosecondsPerSecond), core::name_of(r.state),
                core::name_of(r.stop_reason), core::name_of(r.degradation_level), unsigned{r.degenerate_axes},
                core::name_of(r.clock_source), r.imu_used ? 1 : 0, r.predicted ? 1 : 0, r.guarded ? 1 : 0,
                std::hypot(v[0], v[1], v[2]), r.points, r.points_used, r.correspondences,
                unsigned{r.coarse_iterations}, unsigned{r.fine_iterations}, r.map_voxels, r.lost_packets,
                r.missing_firings, static_cast<unsigned long long>(r.superseded));
  std::string line = cells.data();
  line += r.has_deadline ? duration_cell(1, r.overshoot_ns + 1) : ",";
  // Latency stage i lies between the stamps i and i + 1.
  for (std::size_t i = 0; i + 1 < ipc::kStageCount; ++i)
    line += duration_cell(r.stage_ns[i], r.stage_ns[i + 1]);
  line += duration_cell(r.stage_time_ns(ipc::Stage::kReceived), r.stage_time_ns(ipc::Stage::kDelivered));
  return line + '\n';
}

std::span<const std::uint8_t> bytes_of(std::string_view text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

std::vector<std::uint8_t> header_of(std::string_view text) { return {text.begin(), text.end()}; }

/// Replaces the file as a whole: readers see the old content or the new one.
Result<std::monostate> replace_file(const fs::path& path, const std::string& content) {
  const fs::path written = path.string() + ".new";
  std::error_code error;
  fs::create_directories(path.parent_path(), error);
  std::ofstream file(written);
  file << content;
  if (!file.flush()) return cannot_write(written);
  fs::rename(written, path, error);
  if (error) return cannot_write(path);
  return std::monostate{};
}

}  // namespace

std::string tum_line(const ipc::PoseRecord& record) {
  return tum_line(record.stamp_ns, record.position, record.orientation_xyzw);
}

std::string middle_tum_line(const ipc::PoseRecord& record) {
  const std::int64_t half_sweep_ns = (record.stamp_ns - record.scan_start_ns) / 2;
  return tum_line(record.stamp_ns - half_sweep_ns, record.middle_position, record.middle_orientation_xyzw);
}

RunOutput::RunOutput(const Options& options, drivers::DiskState::Report report)
    : options_(options),
      folder_(options.folder),
      disk_(std::move(report)),
      tum_(folder_ / "trajectory.tum", {}),
      middle_tum_(folder_ / "trajectory_mid.tum", {}),
      kitti_(folder_ / "trajectory.kitti", {}),
      scans_(folder_ / "scans.csv", header_of(scan_table_header())) {
  if (options.mcap) mcap_ = std::make_unique<RunMcap>(folder_ / "run.mcap", options.frames);
}

Result<std::unique_ptr<RunOutput>> RunOutput::create(const Options& options,
                                                     const std::string& effective_config,
                                                     drivers::DiskState::Report report) {
  const fs::path folder(options.folder);
  std::error_code error;
  fs::create_directories(folder, error);
  if (error)
    return Error{folder.string() + ": cannot be made (" + error.message() + ") - choose another --output"};
  if (auto written = replace_file(folder / "config.yaml", effective_config); !written) return written.error();
  return std::unique_ptr<RunOutput>(new RunOutput(options, std::move(report)));
}

void RunOutput::add(const ipc::PoseRecord& record) {
  const core::SE3 T_odom_base = pose_of(record);
  if (!T_base_odom_) T_base_odom_ = T_odom_base.inverse();
  core::SE3 T_first_now = *T_base_odom_ * T_odom_base;
  if (options_.T_camera_lidar) {
    const core::SE3 T_camera_base = *options_.T_camera_lidar * options_.T_base_lidar.inverse();
    T_first_now = T_camera_base * T_first_now * T_camera_base.inverse();
  }
  if (!kitti_.append(bytes_of(kitti_line(T_first_now))) || !tum_.append(bytes_of(tum_line(record))) ||
      !middle_tum_.append(bytes_of(middle_tum_line(record))) ||
      !scans_.append(bytes_of(scan_table_line(record))))
    ++lost_.poses;
  if (mcap_) mcap_->add(record);
}

void RunOutput::open_decisions(const std::string& header) {
  const std::string line = header + '\n';
  decisions_ = drivers::RecordFile(folder_ / "decisions.jsonl", {line.begin(), line.end()});
}

void RunOutput::add(const ScanDecision& decision) {
  if (!decisions_.append(bytes_of(decision_line(decision) + '\n'))) ++lost_.decisions;
}

void RunOutput::add(const CloudRecord& cloud) {
  if (mcap_) mcap_->add(cloud);
}

void RunOutput::take_submaps() {
  if (!mcap_ || !options_.submaps) return;
  if (!submap_) submap_ = std::make_unique<ipc::SubmapCloud>();
  while (options_.submaps->read(*submap_)) mcap_->add(*submap_);
}

void RunOutput::flush(std::int64_t now_ns) {
  if (mcap_) mcap_->close_old_chunk(now_ns);
  if (!disk_.is_due(now_ns)) return;
  std::array<drivers::RecordFile*, 6> files{&tum_,   &middle_tum_, &kitti_,
                                            &scans_, &decisions_,  mcap_ ? &mcap_->file() : nullptr};
  int error = 0;
  for (drivers::RecordFile* const file : files) {
    if (file == nullptr || error != 0) continue;
    error = file->write_pending();
    if (error != 0) disk_.note_failure(file->path(), error, now_ns, lost_.total());
  }
  if (mcap_) lost_.messages = mcap_->lost();
  if (error == 0) disk_.note_success(tum_.path(), lost_.total());
}

Result<std::monostate> RunOutput::finish(const FinalFiles& final_files, std::int64_t now_ns) {
  if (mcap_) mcap_->finish();
  disk_.retry_at_once();
  flush(now_ns);
  if (disk_.is_blocked() || lost_.total() > 0) {
    return Error{folder_.string() + ": " + std::to_string(lost_.total() + tum_.pending_records()) +
                 " records could not be written in time - free space on the disk, or choose a faster one"};
  }
  for (const auto& [name, content] : final_files) {
    if (auto written = replace_file(folder_ / name, content); !written) return written;
  }
  return std::monostate{};
}

}  // namespace nilio::daemon
