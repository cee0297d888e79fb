#include "daemon/input/kitti_sequence.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <sstream>
#include <thread>
#include <vector>

namespace nilio::daemon {

namespace {

namespace fs = std::filesystem;
using core::Error;
using core::Result;

// HDL-64E of the benchmark: beam spacing 0.4 degrees.
constexpr double kBeamSpacingDeg = 0.4;
// Upper limit of a scan file; a scan has about 125,000 points.
constexpr std::uintmax_t kLargestScanBytes = 64ULL * 1024 * 1024;
constexpr std::size_t kBytesPerPoint = 16;

/// Size of a scan file in bytes; 0 if it is not that of a scan.
std::uintmax_t scan_bytes(const fs::path& path) {
  std::error_code error;
  const std::uintmax_t size = fs::file_size(path, error);
  return !error && size <= kLargestScanBytes && size % kBytesPerPoint == 0 ? size : 0;
}

constexpr std::uint16_t kRings = 64;

/// Rank of each point's beam: the files hold ring after ring, the highest first, each from straight ahead
/// counterclockwise. Stays 0 where whole rings are missing, or the order is another one.
void number_rings(std::vector<core::Point>& points) {
  const auto starts_ring = [&points](std::size_t i) {
    return i > 0 && points[i - 1].y < 0.0F && points[i].y >= 0.0F && points[i].x > 0.0F;
  };
  std::size_t starts = 0;
  for (std::size_t i = 0; i < points.size(); ++i) starts += starts_ring(i) ? 1 : 0;
  if (starts != kRings - 1) return;
  std::uint16_t ring = kRings - 1;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (starts_ring(i)) --ring;
    points[i].ring = ring;
  }
}

class KittiScanFeed : public ScanFeed {
 public:
  KittiScanFeed(std::vector<fs::path> files, std::vector<core::Time> stamps)
      : files_(std::move(files)), stamps_(std::move(stamps)) {}

  FeedState next(core::Scan& scan, core::Duration timeout) override {
    while (next_ < files_.size()) {
      if (!is_due(timeout)) return FeedState::kIdle;
      const std::size_t index = next_++;
      // A damaged scan is delivered empty and gets the predicted pose, so that line k stays that of scan k.
      const bool is_whole = load(files_[index], scan);
      scan.sequence = index;
      scan.start = stamps_[index];
      scan.end = stamps_[index];
      scan.motion_compensated = true;
      scan.beam_spacing_rad = static_cast<float>(kBeamSpacingDeg * std::numbers::pi / 180.0);
      scan.coverage_deg = 360.0F;
      scan.received_ns = scan.popped_ns = scan.completed_ns = monotonic_ns();
      ++(is_whole ? stats_.scans : stats_.partial_scans);
      stats_.points += scan.points.size();
      return FeedState::kScan;
    }
    return FeedState::kEnd;
  }
  [[nodiscard]] drivers::ScanAssemblerStats stats() const override { return stats_; }
  void set_pace(std::int64_t start_ns) override { start_ns_ = start_ns; }

 private:
  /// Waits up to `timeout` until the next scan is due.
  [[nodiscard]] bool is_due(core::Duration timeout) const {
    if (!start_ns_) return true;
    const std::int64_t left = *start_ns_ + (stamps_[next_] - stamps_.front()).ns - monotonic_ns();
    if (left > 0) std::this_thread::sleep_for(std::chrono::nanoseconds(std::min(left, timeout.ns)));
    return left <= timeout.ns;
  }

  bool load(const fs::path& path, core::Scan& scan) {
    scan.points.clear();
    const std::uintmax_t size = scan_bytes(path);
    if (size == 0) return false;
    buffer_.resize(size / sizeof(float));
    std::ifstream file(path, std::ios::binary);
    if (!file.read(reinterpret_cast<char*>(buffer_.data()), static_cast<std::streamsize>(size))) return false;
    for (std::size_t i = 0; i + 3 < buffer_.size(); i += 4) {
      core::Point point;
      point.x = buffer_[i];
      point.y = buffer_[i + 1];
      point.z = buffer_[i + 2];
      point.intensity = 255.0F * buffer_[i + 3];
      // Files of some tools end with points at the origin, which are no returns.
      if (point.x != 0.0F || point.y != 0.0F || point.z != 0.0F) scan.points.push_back(point);
    }
    number_rings(scan.points);
    return true;
  }

  std::vector<fs::path> files_;
  std::vector<core::Time> stamps_;
  std::vector<float> buffer_;
  std::size_t next_ = 0;
  std::optional<std::int64_t> start_ns_;
  drivers::ScanAssemblerStats stats_;
};

Result<core::SE3> read_calibration(const fs::path& path) {
  std::ifstream file(path);
  if (!file) return Error{path.string() + ": cannot be read: a KITTI sequence needs its calib.txt"};
  std::string line;
  while (std::getline(file, line)) {
    if (!line.starts_with("Tr:")) continue;
    std::istringstream numbers(line.substr(3));
    Eigen::Matrix<double, 3, 4> matrix;
    for (int i = 0; i < 12; ++i) {
      if (!(numbers >> matrix(i / 4, i % 4))) return Error{path.string() + ": line 'Tr:' needs 12 numbers"};
    }
    return core::se3_from_matrix(matrix);
  }
  return Error{path.string() + ": has no line 'Tr:' (LiDAR to camera)"};
}

Result<std::vector<core::Time>> read_times(const fs::path& path, std::size_t count) {
  std::ifstream file(path);
  if (!file) return Error{path.string() + ": cannot be read: a KITTI sequence needs its times.txt"};
  std::vector<core::Time> stamps;
  std::string line;
  while (stamps.size() < count && std::getline(file, line)) {
    const std::string where = path.string() + ":" + std::to_string(stamps.size() + 1) + ": ";
    std::istringstream text(line);
    double seconds = 0.0;
    if (!(text >> seconds) || !std::isfinite(seconds) || std::abs(seconds) > 4e9)
      return Error{where + "not a time in seconds: '" + line + "'"};
    const core::Time stamp = core::Time::from_seconds(seconds);
    if (!stamps.empty() && stamp <= stamps.back()) return Error{where + "time does not advance"};
    stamps.push_back(stamp);
  }
  if (stamps.size() < count) {
    return Error{path.string() + ": has " + std::to_string(stamps.size()) + " times for " +
                 std::to_string(count) + " scans"};
  }
  return stamps;
}

}  // namespace

bool is_kitti_sequence(const std::string& folder) { return fs::is_directory(fs::path(folder) / "velodyne"); }

Result<KittiSequence> open_kitti_sequence(const std::string& folder) {
  std::vector<fs::path> files;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(fs::path(folder) / "velodyne", error)) {
    if (entry.path().extension() == ".bin") files.push_back(entry.path());
  }
  if (error || files.empty()) return Error{folder + "/velodyne: no scans (*.bin)"};
  std::sort(files.begin(), files.end());
  Result<std::vector<core::Time>> stamps = read_times(fs::path(folder) / "times.txt", files.size());
  if (!stamps) return stamps.error();
  Result<core::SE3> T_camera_lidar = read_calibration(fs::path(folder) / "calib.txt");
  if (!T_camera_lidar) return T_camera_lidar.error();
  KittiSequence sequence;
  sequence.scans = files.size();
  sequence.T_camera_lidar = *T_camera_lidar;
  for (const fs::path& file : files) {
    if (scan_bytes(file) > 0) continue;
    sequence.warnings.push_back("KITTI scan " + file.string() +
                                ": damaged (its size is not that of a scan) - its pose is the predicted one");
  }
  sequence.feed = std::make_unique<KittiScanFeed>(std::move(files), std::move(stamps).value());
  return sequence;
}

}  // namespace nilio::daemon
