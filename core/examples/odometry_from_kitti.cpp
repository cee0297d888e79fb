// Poses of a KITTI odometry sequence: odometry_from_kitti SEQUENCE_FOLDER >poses.txt
// One line a scan, in the format of KITTI's poses: the first three rows of T_odom_lidar.
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <nilio/core/odometry.hpp>
#include <set>

namespace core = nilio::core;

int main(int argc, char** argv) {
  if (argc != 2) return std::fprintf(stderr, "usage: odometry_from_kitti SEQUENCE_FOLDER\n"), 2;
  const std::filesystem::path folder = argv[1];
  std::set<std::filesystem::path> files;  // in the order of their names
  for (const auto& entry : std::filesystem::directory_iterator(folder / "velodyne"))
    files.insert(entry.path());
  std::ifstream times(folder / "times.txt");

  core::Odometry odometry(core::OdometryConfig{});
  core::Scan scan;
  scan.motion_compensated = true;  // KITTI's scans are deskewed already
  scan.beam_spacing_rad = 0.007F;  // HDL-64E: 0.4 degrees
  for (const auto& file : files) {
    double seconds = 0.0;
    if (!(times >> seconds)) return std::fprintf(stderr, "times.txt: fewer times than scans\n"), 1;
    scan.start = scan.end = core::Time::from_seconds(seconds);
    scan.points.clear();
    std::ifstream in(file, std::ios::binary);
    for (float v[4]; in.read(reinterpret_cast<char*>(v), sizeof v);)
      scan.points.push_back({.x = v[0], .y = v[1], .z = v[2], .intensity = 255.0F * v[3]});

    const core::OdometryResult result = odometry.register_scan(scan);
    const Eigen::Matrix3d R = result.T_odom_base.rotation.toRotationMatrix();
    const Eigen::Vector3d& t = result.T_odom_base.translation;
    for (int row = 0; row < 3; ++row)
      std::printf("%.9g %.9g %.9g %.9g%c", R(row, 0), R(row, 1), R(row, 2), t[row], row < 2 ? ' ' : '\n');
    ++scan.sequence;
  }
}
