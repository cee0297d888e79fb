#include "daemon/output/run_output.hpp"

#include <cmath>
#include <cstdio>
#include <filesystem>

namespace nilio::daemon {

namespace {

namespace fs = std::filesystem;
using core::Error;
using core::Result;

// Sufficient for a map picture; 12 bytes each.
constexpr std::size_t kMaxMapPoints = 20'000'000;

Error cannot_write(const fs::path& path) {
  return Error{path.string() +
               ": cannot be written: check that the folder exists, is writable and the disk is not full"};
}

core::SE3 pose_of(const ipc::PoseRecord& record) {
  const auto& q = record.orientation_xyzw;
  return {Eigen::Quaterniond(q[3], q[0], q[1], q[2]),
          core::Vector3(record.position[0], record.position[1], record.position[2])};
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

std::uint64_t voxel_key(const std::array<float, 3>& point, double voxel_m) {
  std::uint64_t key = 0;
  for (const float value : point) {
    const auto cell = static_cast<std::int64_t>(std::floor(static_cast<double>(value) / voxel_m));
    key = key << 21U | (static_cast<std::uint64_t>(cell) & 0x1FFFFFU);
  }
  return key;
}

}  // namespace

std::string tum_line(const ipc::PoseRecord& r) {
  char line[256];
  std::snprintf(line, sizeof line, "%lld.%09lld %.9f %.9f %.9f %.9f %.9f %.9f %.9f\n",
                static_cast<long long>(r.stamp_ns / 1'000'000'000),
                static_cast<long long>(r.stamp_ns % 1'000'000'000), r.position[0], r.position[1],
                r.position[2], r.orientation_xyzw[0], r.orientation_xyzw[1], r.orientation_xyzw[2],
                r.orientation_xyzw[3]);
  return line;
}

Result<std::unique_ptr<RunOutput>> RunOutput::create(const Options& options,
                                                     const std::string& effective_config) {
  auto output = std::unique_ptr<RunOutput>(new RunOutput(options));
  const fs::path folder(options.folder);
  std::error_code error;
  fs::create_directories(folder, error);
  if (error)
    return Error{folder.string() + ": cannot be made (" + error.message() + ") - choose another --output"};
  output->tum_.open(folder / "trajectory.tum");
  if (!output->tum_) return cannot_write(folder / "trajectory.tum");
  output->kitti_.open(folder / "trajectory.kitti");
  if (!output->kitti_) return cannot_write(folder / "trajectory.kitti");
  std::ofstream config(folder / "config.yaml");
  config << effective_config;
  if (!config.flush()) return cannot_write(folder / "config.yaml");
  return output;
}

void RunOutput::add(const ipc::PoseRecord& record) {
  const core::SE3 T_odom_base = pose_of(record);
  if (poses_ == 0) {
    T_base_odom_ = T_odom_base.inverse();
  } else {
    path_length_m_ += (T_odom_base.translation - last_position_).norm();
  }
  last_position_ = T_odom_base.translation;
  ++poses_;
  tum_ << tum_line(record);
  core::SE3 T_first_now = T_base_odom_ * T_odom_base;
  if (options_.T_camera_lidar) {
    const core::SE3 T_camera_base = *options_.T_camera_lidar * options_.T_base_lidar.inverse();
    T_first_now = T_camera_base * T_first_now * T_camera_base.inverse();
  }
  kitti_ << kitti_line(T_first_now);
}

Result<std::monostate> RunOutput::open_decisions(const std::string& header) {
  const fs::path path = fs::path(options_.folder) / "decisions.jsonl";
  decisions_.open(path);
  decisions_ << header << '\n';
  if (!decisions_) return cannot_write(path);
  return std::monostate{};
}

void RunOutput::add(const ScanDecision& decision) { decisions_ << decision_line(decision) << '\n'; }

void RunOutput::add(const CloudRecord& cloud) {
  for (std::size_t i = 0; i < cloud.count && map_points_.size() < kMaxMapPoints; ++i) {
    if (map_voxels_.insert(voxel_key(cloud.points[i], options_.map_voxel_m)).second)
      map_points_.push_back(cloud.points[i]);
  }
}

Result<std::monostate> RunOutput::write_map() const {
  const fs::path path = fs::path(options_.folder) / "map.ply";
  std::ofstream file(path, std::ios::binary);
  file << "ply\nformat binary_little_endian 1.0\nelement vertex " << map_points_.size()
       << "\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
  file.write(reinterpret_cast<const char*>(map_points_.data()),
             static_cast<std::streamsize>(map_points_.size() * sizeof map_points_[0]));
  if (!file.flush()) return cannot_write(path);
  return std::monostate{};
}

Result<std::monostate> RunOutput::write_distributions(const ipc::LatencyHistograms& latency) const {
  const fs::path folder = fs::path(options_.folder) / "latency";
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) return cannot_write(folder);
  for (std::size_t i = 0; i < ipc::kLatencyStageCount; ++i) {
    const fs::path path = folder / (std::string(ipc::kLatencyStageNames[i]) + ".hgrm");
    std::ofstream file(path);
    file << ipc::percentile_distribution(latency.histogram(static_cast<ipc::LatencyStage>(i)).snapshot());
    if (!file.flush()) return cannot_write(path);
  }
  return std::monostate{};
}

Result<std::monostate> RunOutput::finish(const std::string& latency_json,
                                         const ipc::LatencyHistograms& latency) {
  const fs::path folder(options_.folder);
  if (!tum_.flush()) return cannot_write(folder / "trajectory.tum");
  if (!kitti_.flush()) return cannot_write(folder / "trajectory.kitti");
  if (decisions_.is_open() && !decisions_.flush()) return cannot_write(folder / "decisions.jsonl");
  std::ofstream summary(folder / "latency.json");
  summary << latency_json << '\n';
  if (!summary.flush()) return cannot_write(folder / "latency.json");
  if (auto written = write_distributions(latency); !written) return written;
  if (options_.map) return write_map();
  return std::monostate{};
}

}  // namespace nilio::daemon
