#include "tools/bench/sharpness/map_sharpness.hpp"

#include "tests/support/paths.hpp"
#include "tests/support/temporary_folder.hpp"
#include "tools/common/trajectory.hpp"
#include "tools/convert/kitti_raw.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <string>
#include <vector>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::tools;
using namespace nilio::tools::bench;
using Eigen::Isometry3d;
using Eigen::Vector3d;

namespace {

constexpr std::size_t kMappedScans = 20;

/// A wall at x = 20 m seen from the origin by every scan, without noise, at places that differ from scan to
/// scan.
std::vector<Cloud> walls() {
  std::vector<Cloud> scans;
  for (std::size_t k = 0; k < kMappedScans; ++k) {
    Cloud cloud;
    for (int y = -50; y < 50; ++y)
      for (int z = -25; z < 25; ++z)
        cloud.emplace_back(20.0, 0.1 * y + 0.003 * static_cast<double>(k),
                           0.1 * z + 0.002 * static_cast<double>(k));
    scans.push_back(cloud);
  }
  return scans;
}

/// Poses whose scans are alternately `offset` ahead of and behind the truth, by their order among the used
/// scans.
std::vector<Isometry3d> shifted(double offset) {
  std::vector<Isometry3d> poses(kMappedScans, Isometry3d::Identity());
  for (std::size_t k = 0; k < kMappedScans; ++k)
    poses[k].translation().x() = (k / 2) % 2 == 0 ? offset : -offset;
  return poses;
}

std::vector<Isometry3d> read_poses(const std::filesystem::path& path) {
  const auto trajectory = read_trajectory(path.string());
  REQUIRE(trajectory);
  return trajectory->poses;
}

/// Clouds of the first 51 scans of an archive, unpacked into `folder`.
std::vector<Cloud> clouds_of(const std::filesystem::path& archive, const std::filesystem::path& folder) {
  REQUIRE(std::system(("tar -xJf " + archive.string() + " -C " + folder.string()).c_str()) == 0);
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder))
    if (entry.path().extension() == ".bin") files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  std::vector<Cloud> clouds;
  for (const auto& file : files) {
    const auto points = convert::read_kitti_scan(file);
    REQUIRE(points);
    Cloud cloud;
    for (const convert::KittiPoint& p : *points) cloud.emplace_back(p.x, p.y, p.z);
    clouds.push_back(prepare_scan(std::move(cloud), 0.205));
  }
  return clouds;
}

/// Figures of the reference implementation (map_sharpness.py): shift median and rms, thickness median,
/// quartile.
struct Reference {
  const char* poses;
  double shift_median_mm, shift_rms_mm, thickness_median_mm, thickness_quartile_mm, entropy, coverage;
};

void check_against(const Reference& reference, const Sharpness& figures) {
  INFO(reference.poses);
  CHECK(figures.shift_median_mm == Approx(reference.shift_median_mm).epsilon(0.01));
  CHECK(figures.shift_rms_mm == Approx(reference.shift_rms_mm).epsilon(0.01));
  CHECK(figures.thickness_median_mm == Approx(reference.thickness_median_mm).epsilon(0.01));
  CHECK(figures.thickness_quartile_mm == Approx(reference.thickness_quartile_mm).epsilon(0.01));
  CHECK(figures.entropy == Approx(reference.entropy).epsilon(0.01));
  CHECK(figures.coverage == Approx(reference.coverage).epsilon(0.01));
}

}  // namespace

TEST_CASE("exact poses give a sharp wall, and shifts of single scans are measured as they are",
          "[map_sharpness]") {
  const std::vector<Cloud> scans = walls();
  const auto exact = measure_sharpness(scans, std::vector<std::vector<Isometry3d>>{shifted(0.0)}, {});
  REQUIRE(exact.size() == 1);
  CHECK(exact[0].windows == 1);
  CHECK(exact[0].anchors > 20);
  CHECK(exact[0].shift_median_mm < 1e-3);
  CHECK(exact[0].thickness_median_mm < 1e-3);

  // Ten scans, the sixth is the anchors' own: of the other nine, five are ahead of it or four, by 20 mm.
  const auto blunt = measure_sharpness(scans, std::vector<std::vector<Isometry3d>>{shifted(0.01)}, {});
  const double expected_mm = 20.0 * std::sqrt(5.0 / 9.0 * 4.0 / 9.0);
  CHECK(blunt[0].shift_median_mm == Approx(expected_mm).epsilon(0.01));
  CHECK(blunt[0].thickness_median_mm == Approx(expected_mm).epsilon(0.02));
}

TEST_CASE("a trajectory that loses anchors loses them for all, and its coverage says so", "[map_sharpness]") {
  const std::vector<Cloud> scans = walls();
  std::vector<Isometry3d> broken = shifted(0.0);
  // Of the scans beside the middle one, four see only a part of its wall, the others are far away.
  for (std::size_t k = 0; k < kMappedScans; ++k) broken[k].translation().y() = k < 8 ? 3.0 : 1000.0;
  broken[10].translation().y() = 0.0;
  const auto both = measure_sharpness(scans, std::vector<std::vector<Isometry3d>>{shifted(0.0), broken}, {});
  REQUIRE(both.size() == 2);
  CHECK(both[0].anchors == both[1].anchors);
  CHECK(both[1].coverage < both[0].coverage);
}

TEST_CASE("fewer scans than a window give no figure", "[map_sharpness]") {
  std::vector<Cloud> scans = walls();
  scans.pop_back();
  CHECK(measure_sharpness(scans, std::vector<std::vector<Isometry3d>>{shifted(0.0)}, {}).empty());
}

TEST_CASE("compensation brings the points of a turning and moving sensor to the middle of the sweep",
          "[map_sharpness]") {
  // Scans 0.1 s apart at 10 m/s and 20 degrees a second.
  std::vector<Isometry3d> poses;
  for (int i = 0; i < 10; ++i) {
    Isometry3d pose = Isometry3d::Identity();
    pose.linear() = Eigen::AngleAxisd(i * 2.0 * M_PI / 180.0, Vector3d::UnitZ()).toRotationMatrix();
    if (i > 0)
      pose.translation() = poses.back().translation() + poses.back().linear() * Vector3d(1.0, 0.0, 0.0);
    poses.push_back(pose);
  }
  const ScanMotion motion = mean_motion(poses, 5);
  CHECK(motion[0] == Approx(1.0).epsilon(0.01));
  CHECK(motion[5] == Approx(2.0 * M_PI / 180.0).epsilon(0.01));
  // To the left at a quarter of a turn before the middle: the sensor was 0.25 m behind.
  const Cloud moved = compensate({Vector3d(0.0, 10.0, 0.0), Vector3d(10.0, 0.0, 0.0)}, motion);
  CHECK(moved[0].x() == Approx(-0.25 * motion[0] + 0.25 * 10.0 * motion[5]).epsilon(1e-6));
  CHECK(moved[1] == Vector3d(10.0, 0.0, 0.0));
}

TEST_CASE("sharpness on two real drives equals the reference implementation to one per cent",
          "[map_sharpness]") {
  NILIO_REQUIRE_DATA(kitti, "kitti");
  {
    const tests::TemporaryFolder folder;
    const std::vector<Reference> references{
        {"seq04.kiss.txt", 9.0347, 12.1284, 11.6090, 8.3009, -2.19054, 0.77867},
        {"seq04.vgicp_model.txt", 7.1550, 10.0199, 9.7055, 7.0608, -2.25562, 0.77780},
        {"seq04.mad.txt", 9.0289, 11.9526, 12.1606, 8.3386, -2.18592, 0.77924}};
    const std::vector<Cloud> clouds = clouds_of(kitti / "odometry_04_frames_000-050.tar.xz", folder.path());
    std::vector<std::vector<Isometry3d>> poses;
    for (const Reference& reference : references)
      poses.push_back(read_poses(kitti / "peer_trajectories" / reference.poses));
    const std::vector<Sharpness> figures = measure_sharpness(clouds, poses, {});
    REQUIRE(figures.size() == references.size());
    for (std::size_t k = 0; k < figures.size(); ++k) check_against(references[k], figures[k]);
  }
  {
    const tests::TemporaryFolder folder;
    const std::vector<Reference> references{
        {"raw0009.kiss.txt", 12.2754, 16.2849, 18.2862, 11.3661, -2.24003, 0.82717},
        {"raw0009.vgicp_model.txt", 7.4516, 11.5597, 12.6727, 6.6922, -2.43322, 0.82640},
        {"raw0009.mad.txt", 8.4537, 12.2304, 14.0684, 7.7714, -2.38226, 0.82564}};
    const std::vector<Cloud> clouds =
        clouds_of(kitti / "raw_2011_09_26_drive_0009_scans_00-50.tar.xz", folder.path());
    std::vector<std::vector<Isometry3d>> poses;
    for (const Reference& reference : references)
      poses.push_back(read_poses(kitti / "peer_trajectories" / reference.poses));
    const std::vector<Sharpness> figures = measure_sharpness(clouds, poses, {});
    REQUIRE(figures.size() == references.size());
    for (std::size_t k = 0; k < figures.size(); ++k) check_against(references[k], figures[k]);
  }
}
