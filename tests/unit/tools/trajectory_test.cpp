#include "tools/common/trajectory.hpp"

#include "tests/support/temporary_folder.hpp"

#include <cmath>

using nilio::core::Duration;
using nilio::core::Time;
using nilio::tests::TemporaryFolder;
using namespace nilio::tools;

namespace {

std::string error_of(const TemporaryFolder& folder, const std::string& content) {
  const auto trajectory = read_trajectory(folder.write("t.txt", content));
  return trajectory ? std::string() : trajectory.error().message;
}

}  // namespace

TEST_CASE("a TUM file keeps its stamps to the nanosecond", "[trajectory]") {
  const TemporaryFolder folder;
  const std::string path =
      folder.write("t.tum",
                   "# time x y z qx qy qz qw\n"
                   "1317042504.969505176 1 2 3 0 0 0 1\r\n"
                   "\n"
                   "1317042505.000000001\t4 5 6 0 0 0.7071067811865476 0.7071067811865476\n");
  const auto trajectory = read_trajectory(path);
  REQUIRE(trajectory);
  REQUIRE(trajectory->format == TrajectoryFormat::kTum);
  REQUIRE(trajectory->stamps.size() == 2);
  CHECK(trajectory->stamps[0].ns == 1317042504969505176);
  CHECK(trajectory->stamps[1].ns == 1317042505000000001);
  CHECK(trajectory->poses[1].translation().isApprox(Eigen::Vector3d(4, 5, 6)));
  // A quarter turn to the left: x becomes y.
  CHECK((trajectory->poses[1].linear() * Eigen::Vector3d::UnitX()).isApprox(Eigen::Vector3d::UnitY(), 1e-12));
}

TEST_CASE("a KITTI file is recognised by its twelve columns and kept as written", "[trajectory]") {
  const TemporaryFolder folder;
  const auto trajectory =
      read_trajectory(folder.write("t.txt", "1 0 0 4 0 1 0 5 0 0 1 6\n1 0 0 7 0 1e0 0 +8 0 0 1 9\n"));
  REQUIRE(trajectory);
  CHECK(trajectory->format == TrajectoryFormat::kKitti);
  CHECK(trajectory->stamps.empty());
  REQUIRE(trajectory->poses.size() == 2);
  CHECK(trajectory->poses[1].translation() == Eigen::Vector3d(7, 8, 9));
}

TEST_CASE("a malformed trajectory is refused with file, line and reason", "[trajectory]") {
  const TemporaryFolder folder;
  const std::string good = "1 0 0 0 0 0 0 1\n";
  const auto expect = [&](const std::string& content, const std::string& line, const std::string& reason) {
    const std::string message = error_of(folder, content);
    CAPTURE(message);
    CHECK(message.find("t.txt" + line) != std::string::npos);
    CHECK(message.find(reason) != std::string::npos);
  };
  expect("", ": ", "no pose");
  expect("# only a comment\n", ": ", "no pose");
  expect(good + "2 0 0 0 0 0 1\n", ":2: ", "7 columns");
  expect(good + "1 0 0 4 0 1 0 5 0 0 1 6\n", ":2: ", "12 columns, where the lines before have 8");
  expect(good + "2 0 nan 0 0 0 0 1\n", ":2: ", "finite");
  expect(good + "2 0 1e999 0 0 0 0 1\n", ":2: ", "finite");
  expect(good + "2 0 0x10 0 0 0 0 1\n", ":2: ", "finite");
  expect(good + "1 0 0 0 0 0 0 1\n", ":2: ", "does not increase");
  expect(good + "1e30 0 0 0 0 0 0 1\n", ":2: ", "out of range");
  expect(good + "2 0 0 0 0 0 0 0\n", ":2: ", "unit quaternion");
  expect("1 0 0 4 0 -1 0 5 0 0 1 6\n", ":1: ", "rotation matrix");
  expect("1 0 4 0 0 1 5 0 0 0 6 1\n", ":1: ", "rotation matrix");
  CHECK(read_trajectory(folder.file("missing")).error().message.find("cannot be opened") !=
        std::string::npos);
}

TEST_CASE("a written trajectory reads back as it was", "[trajectory]") {
  const TemporaryFolder folder;
  Trajectory original;
  original.stamps = {Time{1317042504969505176}, Time{1317042505069505177}};
  Pose pose = Pose::Identity();
  original.poses.push_back(pose);
  pose.linear() = Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, 3).normalized()).toRotationMatrix();
  pose.translation() << -1234.5678901, 1e-6, 3.0;
  original.poses.push_back(pose);
  for (const TrajectoryFormat format : {TrajectoryFormat::kTum, TrajectoryFormat::kKitti}) {
    original.format = format;
    REQUIRE(write_trajectory(original, folder.file("t")));
    const auto copy = read_trajectory(folder.file("t"));
    REQUIRE(copy);
    CHECK(copy->format == format);
    CHECK((copy->poses[1].matrix() - pose.matrix()).cwiseAbs().maxCoeff() < 1e-8);
    if (format == TrajectoryFormat::kTum) CHECK(copy->stamps == original.stamps);
  }
  CHECK_FALSE(write_trajectory(original, folder.file("no/such/folder")));
}

TEST_CASE("interpolation turns and moves evenly and does not bridge gaps or extrapolate", "[trajectory]") {
  Trajectory trajectory;
  trajectory.stamps = {Time{0}, Time{100'000'000}, Time{600'000'000}};
  Pose end = Pose::Identity();
  end.linear() = Eigen::AngleAxisd(0.8, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  end.translation() << 4.0, 0.0, 0.0;
  trajectory.poses = {Pose::Identity(), end, end};
  const Duration gap{200'000'000};
  const auto quarter = interpolate_pose(trajectory, Time{25'000'000}, gap);
  REQUIRE(quarter);
  CHECK(quarter->translation().x() == Approx(1.0));
  CHECK(Eigen::AngleAxisd(quarter->linear()).angle() == Approx(0.2));
  CHECK(interpolate_pose(trajectory, Time{100'000'000}, gap)->matrix() == end.matrix());
  CHECK_FALSE(interpolate_pose(trajectory, Time{300'000'000}, gap));
  CHECK(interpolate_pose(trajectory, Time{300'000'000}, Duration{500'000'000}));
  CHECK_FALSE(interpolate_pose(trajectory, Time{-1}, gap));
  CHECK_FALSE(interpolate_pose(trajectory, Time{600'000'001}, gap));
}

TEST_CASE("the LiDAR-to-camera transform is taken from the Tr line of a KITTI calibration", "[trajectory]") {
  const TemporaryFolder folder;
  const auto calibration =
      read_kitti_calibration(folder.write("calib.txt", "P0: 1 2 3\nTr: 0 -1 0 1 0 0 -1 2 1 0 0 3\n"));
  REQUIRE(calibration);
  CHECK((*calibration * Eigen::Vector3d(10, 0, 0)).isApprox(Eigen::Vector3d(1, 2, 13)));
  CHECK(read_kitti_calibration(folder.write("no_tr.txt", "P0: 1 2 3\n")).error().message.find("Tr:") !=
        std::string::npos);
  CHECK(read_kitti_calibration(folder.write("bad.txt", "P0: 1\nTr: 1 2 3\n"))
            .error()
            .message.find("bad.txt:2") != std::string::npos);
}
