// Injects drift into the map of a run: heading and scale per metre of path, a bias of odometry. Keyframes and
// surfaces move along with the pose that has seen them.
//
//   nilio-bend-map RUN OUTPUT DEGREES_PER_100_M SCALE_PERCENT
// Writes OUTPUT/map and OUTPUT/trajectory.tum.

#include "tools/common/trajectory.hpp"

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <iostream>
#include <numbers>
#include <string>

#include "mapping/map_folder.hpp"

namespace {

using namespace nilio;
using core::SE3;
using tools::Trajectory;

Trajectory bent(const Trajectory& odometry, double radians_per_metre, double scale) {
  Trajectory result = odometry;
  SE3 before = tools::se3_of(odometry.poses.front());
  SE3 T = before;
  for (std::size_t i = 1; i < odometry.poses.size(); ++i) {
    const SE3 pose = tools::se3_of(odometry.poses[i]);
    const core::Vector3 step = scale * (pose.translation - before.translation);
    // In axes of odom: the vertical stays vertical.
    const Eigen::Quaterniond turn = T.rotation * before.rotation.conjugate();
    const Eigen::Quaterniond more = core::so3_exp({0.0, 0.0, radians_per_metre * step.norm()});
    T.translation += turn * step;
    T.rotation = (more * turn * pose.rotation).normalized();
    before = pose;
    result.poses[i] = T.matrix();
  }
  return result;
}

/// T_bent_odom at a time; that of the end beyond it.
SE3 bend_at(const Trajectory& from, const Trajectory& to, core::Time stamp) {
  const core::Time inside = std::clamp(stamp, from.stamps.front(), from.stamps.back());
  const core::Duration gap{std::int64_t{1} << 60};
  const auto a = interpolate_pose(from, inside, gap);
  const auto b = interpolate_pose(to, inside, gap);
  return tools::se3_of(*b) * tools::se3_of(*a).inverse();
}

int fail(const std::string& message) {
  std::cerr << message << '\n';
  return EXIT_FAILURE;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 5) return fail("nilio-bend-map RUN OUTPUT DEGREES_PER_100_M SCALE_PERCENT");
  const std::filesystem::path run = argv[1];
  const std::filesystem::path output = argv[2];
  const auto odometry = tools::read_trajectory(run / "trajectory.tum");
  if (!odometry) return fail(odometry.error().message);
  const Trajectory drifted = bent(*odometry, std::atof(argv[3]) / 100.0 * std::numbers::pi / 180.0,
                                  1.0 + std::atof(argv[4]) / 100.0);
  const auto map = mapping::MapReader::open(run / "map");
  if (!map) return fail(map.error().message);
  auto writer = mapping::MapWriter::open(output / "map", "bent", map->header().created);
  if (!writer) return fail(writer.error().message);
  for (const mapping::SubmapEntry& entry : map->submaps()) {
    auto submap = map->load(entry);
    if (!submap) return fail(submap.error().message);
    const SE3 T_odom_submap = submap->T_odom_submap;
    // Axes of odom, as before: the heading of a submap is that of its surfaces.
    submap->T_odom_submap.translation =
        bend_at(*odometry, drifted, entry.first_stamp) * T_odom_submap.translation;
    const SE3 T_submap_odom = submap->T_odom_submap.inverse();
    std::vector<SE3> moves;
    for (mapping::SubmapKeyframe& keyframe : submap->keyframes) {
      moves.push_back(T_submap_odom * bend_at(*odometry, drifted, keyframe.stamp) * T_odom_submap);
      keyframe.T_submap_base = moves.back() * keyframe.T_submap_base;
    }
    for (mapping::Surface& surface : submap->surfaces) {
      const SE3& move = moves[std::min<std::size_t>(surface.keyframe, moves.size() - 1)];
      surface.mean = (move * surface.mean.cast<double>()).cast<float>();
      surface.normal = (move.rotation * surface.normal.cast<double>()).cast<float>();
    }
    if (const auto written = writer->write(*submap, map->header().created); !written)
      return fail(written.error().message);
  }
  const auto written = tools::write_trajectory(drifted, output / "trajectory.tum");
  return written ? EXIT_SUCCESS : fail(written.error().message);
}
