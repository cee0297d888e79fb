#include "mapping/trajectory_correction.hpp"

#include "tests/support/street_map.hpp"
#include "tests/support/temporary_folder.hpp"

#include <cmath>
#include <sstream>
#include <string>

#include <catch2/catch.hpp>

namespace {

using namespace nilio;
using namespace nilio::mapping;
using Catch::Matchers::Contains;

/// trajectory.tum of the street: a pose each metre, from 1 m before the map to 1 m behind it.
std::string street_trajectory() {
  std::string text;
  for (int i = -1; i < 91; ++i) {
    const std::int64_t ns = 1'000'000'000'000LL + i * 100'000'000LL;
    text += std::to_string(ns / 1'000'000'000) + "." +
            std::to_string(1'000'000'000 + ns % 1'000'000'000).substr(1) + " " + std::to_string(i) +
            ".000000000 0.300000000 2.000000000 0.000000000 0.000000000 0.000000000 "
            "1.000000000\n";
  }
  return text;
}

struct Row {
  std::string stamp;
  double x = 0.0;
  double y = 0.0;
};

std::vector<Row> rows_of(const std::string& path) {
  std::istringstream file(tests::read_file(path));
  std::vector<Row> rows;
  for (std::string line; std::getline(file, line);) {
    std::istringstream in(line);
    Row row;
    in >> row.stamp >> row.x >> row.y;
    rows.push_back(row);
  }
  return rows;
}

}  // namespace

TEST_CASE("a trajectory is moved along with the submaps of its map", "[trajectory_correction]") {
  const tests::TemporaryFolder folder;
  const auto map_folder = folder.path() / "map";
  const MapReader map = tests::street_map(map_folder);
  const std::string trajectory = folder.write("trajectory.tum", street_trajectory());
  const std::string output = folder.file("optimised.tum");
  REQUIRE(correct_trajectory(map, trajectory, output).value() == 92);
  auto rows = rows_of(output);
  REQUIRE(rows.size() == 92);
  CHECK(rows.front().stamp == "999.900000000");
  CHECK(rows.back().stamp == "1009.000000000");
  for (std::size_t i = 0; i < rows.size(); ++i)
    CHECK(rows[i].x == Approx(static_cast<double>(i) - 1.0).margin(1e-8));
  // The last submap is moved by 2 m: what lies between it and the one before moves in part.
  MapCorrection correction;
  for (const SubmapEntry& entry : map.submaps()) correction.poses.emplace_back(entry.id, entry.T_odom_submap);
  correction.poses.back().second.translation.y() += 2.0;
  {
    auto writer = MapWriter::open(map_folder, "test", {1});
    REQUIRE(writer.ok());
    REQUIRE(writer->write(correction).ok());
  }
  REQUIRE(correct_trajectory(MapReader::open(map_folder).value(), trajectory, output).ok());
  rows = rows_of(output);
  CHECK(rows.front().y == Approx(0.3));
  CHECK(rows.back().y == Approx(2.3));
  int between = 0;
  for (std::size_t i = 1; i < rows.size(); ++i) {
    CHECK(rows[i].y >= rows[i - 1].y - 1e-8);
    CHECK(rows[i].y - rows[i - 1].y < 0.2);
    if (rows[i].y > 0.31 && rows[i].y < 2.29) ++between;
  }
  CHECK(between > 10);
}

TEST_CASE("a trajectory that niliod has not written is refused with its line", "[trajectory_correction]") {
  const tests::TemporaryFolder folder;
  const MapReader map = tests::street_map(folder.path() / "map");
  const std::string good = "1000.000000000 1 2 3 0 0 0 1\n";
  for (const char* const bad : {"1000.1 1 2 3 0 0 0\n", "1000.1 1 2 3 0 0 0 2\n", "1000.1 1 2 nan 0 0 0 1\n",
                                "\n", "99999999999.0 1 2 3 0 0 0 1\n", "seconds x y z qx qy qz qw\n", "-"}) {
    const std::string path = folder.write("bad.tum", good + bad);
    INFO(bad);
    const auto corrected = correct_trajectory(map, path, folder.file("out.tum"));
    REQUIRE_FALSE(corrected.ok());
    CHECK_THAT(corrected.error().message, Contains("bad.tum:2: not a pose"));
  }
  CHECK_FALSE(correct_trajectory(map, folder.file("none.tum"), folder.file("out.tum")).ok());
  CHECK_FALSE(std::filesystem::exists(folder.file("out.tum")));
}

TEST_CASE("a pose in the frame of a saved map has the last transform before it, and none before the first",
          "[trajectory_correction]") {
  const tests::TemporaryFolder folder;
  const std::string trajectory = folder.write("trajectory.tum", street_trajectory());
  const std::string localisation = folder.write("localisation.txt",
                                                "1001.000000000 0 5 0 0 0 0 1 localised 0.9 0.05 0.1\n"
                                                "1002.000000000 0 7 0 0 0 0 1 odometry_only 0.1 0.05 0.1\n");
  const std::string output = folder.file("map.tum");
  REQUIRE(localise_trajectory(localisation, trajectory, output).value() == 81);
  const auto rows = rows_of(output);
  REQUIRE(rows.size() == 81);
  CHECK(rows.front().stamp == "1001.000000000");
  CHECK(rows.front().y == Approx(5.3));
  CHECK(rows[9].y == Approx(5.3));
  CHECK(rows[10].y == Approx(7.3));
  CHECK(rows.back().y == Approx(7.3));
  const auto refused = localise_trajectory(folder.write("bad.txt", "localised\n"), trajectory, output);
  REQUIRE_FALSE(refused.ok());
  CHECK_THAT(refused.error().message, Contains("bad.txt:1: not a pose"));
}
