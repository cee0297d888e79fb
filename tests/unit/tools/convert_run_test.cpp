#include "tests/support/temporary_folder.hpp"
#include "tests/support/tools/run_command.hpp"
#include "tools/commands/commands.hpp"
#include "tools/common/trajectory.hpp"
#include "tools/convert/run.hpp"
#include "tools/convert/run_poses.hpp"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include <catch2/catch.hpp>
#include <nlohmann/json.hpp>

using namespace nilio::tools;
using namespace nilio::tools::convert;
using Catch::Matchers::Contains;
using nilio::tests::read_file;
using nilio::tests::run_command;
using nilio::tests::TemporaryFolder;

namespace {

/// Ten poses, 100 m apart along the x axis, that turn left.
const std::string kPoses = [] {
  std::string lines = "# a comment\n";
  for (int i = 0; i < 10; ++i) {
    const double half_yaw = 0.05 * i;
    lines += "1700000000." + std::to_string(i) + "00000001 " + std::to_string(100 * i) + " 0 1.5 0 0 " +
             std::to_string(std::sin(half_yaw)) + " " + std::to_string(std::cos(half_yaw)) + "\n";
  }
  return lines;
}();

RunOptions conversion(const std::string& run, RunFormat format, const std::string& output = {},
                      const std::string& topic = {}) {
  RunOptions options;
  options.run = run;
  options.format = format;
  options.output = output;
  options.topic = topic;
  return options;
}

std::string message_of(const RunOptions& options) {
  const auto converted = convert_run(options);
  REQUIRE_FALSE(converted.ok());
  return converted.error().message;
}

}  // namespace

TEST_CASE("a run is converted to one table of its poses and scans", "[run]") {
  const TemporaryFolder folder;
  REQUIRE_FALSE(folder.write("trajectory.tum", kPoses).empty());
  REQUIRE_FALSE(
      folder.write("scans.csv", "scan,stamp_s,state,speed\n7,1700000000.100000001,tracking,1.25\n").empty());
  const std::string output = folder.file("run.csv");
  REQUIRE(run_command(add_convert_command,
                      {"convert", "run", folder.text(), "--to", "csv", "--output", output}) == 0);
  const std::string text = read_file(output);
  CHECK_THAT(text, Catch::StartsWith(
                       "stamp_s,x_m,y_m,z_m,qx,qy,qz,qw,roll_deg,pitch_deg,yaw_deg,path_m,state,speed\n"));
  CHECK_THAT(text, Contains("\n1700000000.000000001,0.000000000,0.000000000,1.500000000,") &&
                       Contains(",0.0000,,\n"));
  CHECK_THAT(text, Contains("\n1700000000.100000001,100.000000000,") && Contains(",5.7295") &&
                       Contains(",100.0000,tracking,1.25\n"));
  CHECK(std::ranges::count(text, '\n') == 11);
}

TEST_CASE("poses survive the way through an MCAP file", "[run]") {
  const TemporaryFolder folder;
  const std::string tum = folder.write("truth.tum", kPoses);
  const std::string mcap = folder.file("poses.mcap");
  REQUIRE(convert_run(conversion(tum, RunFormat::kMcap, mcap)).ok());
  const auto expected = read_trajectory(tum);
  const auto poses = read_bag_poses(mcap, "");
  REQUIRE(expected.ok());
  REQUIRE(poses.ok());
  CHECK(poses->stamps == expected->stamps);
  REQUIRE(poses->poses.size() == 10);
  for (std::size_t i = 0; i < 10; ++i)
    CHECK((poses->poses[i].matrix() - expected->poses[i].matrix()).cwiseAbs().maxCoeff() < 1e-9);
  const std::string back = folder.file("back.tum");
  REQUIRE(convert_run(conversion(mcap, RunFormat::kTum, back, "/pose")).ok());
  CHECK_THAT(read_file(back), Contains("1700000000.900000001 900.000000000 0.000000000 1.500000000 "));
}

TEST_CASE("a trajectory is a line on the map where its origin is given", "[run]") {
  const TemporaryFolder folder;
  const std::string tum = folder.write("truth.tum", kPoses);
  const std::string output = folder.file("line.geojson");
  REQUIRE(run_command(add_convert_command, {"convert", "run", tum, "--to", "geojson", "--origin",
                                            "49.0,8.4,115,90", "--output", output}) == 0);
  const auto collection = nlohmann::json::parse(read_file(output));
  CHECK(collection["type"] == "FeatureCollection");
  const auto& feature = collection["features"][0];
  const auto& line = feature["geometry"]["coordinates"];
  REQUIRE(line.size() == 10);
  CHECK(line[0][0].get<double>() == Approx(8.4).margin(1e-8));
  CHECK(line[0][1].get<double>() == Approx(49.0).margin(1e-8));
  CHECK(line[0][2].get<double>() == Approx(116.5).margin(1e-3));
  CHECK(line[9][0].get<double>() > 8.41);
  CHECK(feature["properties"]["coordTimes"][1] == "2023-11-14T22:13:20.100Z");
  CHECK(feature["properties"]["path_length_m"].get<double>() == Approx(900.0));
  CHECK_THAT(message_of(conversion(tum, RunFormat::kGeoJson)), Contains("--origin"));
  CHECK(run_command(add_convert_command,
                    {"convert", "run", tum, "--to", "geojson", "--origin", "95,8.4,115,90"}) != 0);
}

TEST_CASE("what a conversion of a run lacks is named", "[run]") {
  const TemporaryFolder folder;
  const std::string kitti = folder.write("poses.kitti", "1 0 0 5 0 1 0 6 0 0 1 7\n");
  CHECK_THAT(message_of(conversion(kitti, RunFormat::kCsv)), Contains("has no times"));
  CHECK(convert_run(conversion(kitti, RunFormat::kKitti, folder.file("copy.kitti"))).ok());
  CHECK_THAT(message_of(conversion(folder.text(), RunFormat::kTum)),
             Contains("holds neither trajectory.tum nor a ROS bag"));
  CHECK_THAT(message_of(conversion(folder.file("none.tum"), RunFormat::kTum)), Contains("none.tum"));
  const std::string tum = folder.write("truth.tum", kPoses);
  CHECK_THAT(message_of(conversion(tum, RunFormat::kMcap)), Contains("--output"));
  const std::string mcap = folder.file("poses.mcap");
  REQUIRE(convert_run(conversion(tum, RunFormat::kMcap, mcap)).ok());
  CHECK_THAT(message_of(conversion(mcap, RunFormat::kTum, "", "/odom")),
             Contains("'/odom' has no poses") && Contains("/pose (geometry_msgs/PoseStamped)"));
}
