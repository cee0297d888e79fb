#include "tools/map/export.hpp"

#include "tests/support/street_map.hpp"
#include "tests/support/temporary_folder.hpp"

#include <cstring>
#include <fstream>
#include <iterator>
#include <sstream>
#include <string>
#include <vector>

#include <catch2/catch.hpp>
#include <nlohmann/json.hpp>

#include "mapping/ply_file.hpp"

namespace {

using namespace nilio;
using namespace nilio::tools;
using namespace nilio::tools::map;
using Catch::Matchers::Contains;

std::vector<CloudPoint> sample_cloud() {
  std::vector<CloudPoint> cloud;
  for (int i = 0; i < 3; ++i) {
    CloudPoint point;
    point.position = {100.25 + i, -2000.5, 0.125 * i};
    point.normal = {0.0F, i == 1 ? 1.0F : 0.0F, i == 1 ? 0.0F : 1.0F};
    point.intensity = 100.0F * static_cast<float>(i);
    point.thickness_m = 0.01F;
    point.stamp = {1'700'000'000'500'000'000 + i};
    cloud.push_back(point);
  }
  return cloud;
}

template <class T>
T at(const std::string& bytes, std::size_t offset) {
  T value{};
  REQUIRE(offset + sizeof(T) <= bytes.size());
  std::memcpy(&value, bytes.data() + offset, sizeof(T));
  return value;
}

/// Bytes of the file that is written.
std::string encode_cloud(const std::vector<CloudPoint>& cloud, const std::string& extension) {
  const tests::TemporaryFolder folder;
  REQUIRE(write_cloud(cloud, folder.file("cloud" + extension)).ok());
  std::ifstream file(folder.file("cloud" + extension), std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

/// Bytes behind the line with this text.
std::string body_of(const std::string& bytes, const std::string& last_line) {
  const std::size_t begin = bytes.find(last_line + "\n");
  REQUIRE(begin != std::string::npos);
  return bytes.substr(begin + last_line.size() + 1);
}

}  // namespace

TEST_CASE("a PLY file has the properties that its header lists", "[export]") {
  const std::string bytes = encode_cloud(sample_cloud(), ".ply");
  CHECK_THAT(bytes, Contains("element vertex 3\nproperty float x\n") &&
                        Contains("property double gps_time\nend_header"));
  const std::string body = body_of(bytes, "end_header");
  constexpr std::size_t row = 7 * 4 + 3 + 8;
  REQUIRE(body.size() == 3 * row);
  CHECK(at<float>(body, row) == 101.25F);
  CHECK(at<float>(body, row + 4) == -2000.5F);
  CHECK(at<float>(body, row + 8) == 0.125F);
  CHECK(at<float>(body, row + 16) == 1.0F);  // ny
  CHECK(at<float>(body, row + 24) == 100.0F);
  CHECK(at<std::uint8_t>(body, row + 28) == 100);
  CHECK(at<double>(body, row + 31) == Approx(1'700'000'000.5));
}

TEST_CASE("a PCD file has the fields of PointXYZINormal and the time", "[export]") {
  const std::string bytes = encode_cloud(sample_cloud(), ".pcd");
  CHECK_THAT(bytes, Contains("FIELDS x y z intensity normal_x normal_y normal_z curvature time\n") &&
                        Contains("WIDTH 3 ") && Contains("POINTS 3 "));
  const std::string body = body_of(bytes, "DATA binary");
  REQUIRE(body.size() == 3 * 40);
  CHECK(at<float>(body, 2 * 40) == 102.25F);
  CHECK(at<float>(body, 2 * 40 + 12) == 200.0F);
  CHECK(at<float>(body, 2 * 40 + 24) == 1.0F);
  CHECK(at<float>(body, 2 * 40 + 28) == 0.01F);
}

TEST_CASE("a LAS 1.4 file is read by the offsets of the specification", "[export]") {
  const std::string bytes = encode_cloud(sample_cloud(), ".las");
  CHECK(bytes.substr(0, 4) == "LASF");
  CHECK(at<std::uint16_t>(bytes, 6) == 0x11);  // adjusted GPS time, WKT
  CHECK(at<std::uint8_t>(bytes, 24) == 1);
  CHECK(at<std::uint8_t>(bytes, 25) == 4);
  CHECK(at<std::uint16_t>(bytes, 94) == 375);
  const auto first = at<std::uint32_t>(bytes, 96);
  const auto records = at<std::uint32_t>(bytes, 100);
  CHECK(at<std::uint8_t>(bytes, 104) == 6);
  const auto length = at<std::uint16_t>(bytes, 105);
  CHECK(length == 30 + 12);
  CHECK(at<std::uint32_t>(bytes, 107) == 0);
  CHECK(at<std::uint64_t>(bytes, 247) == 3);
  CHECK(at<std::uint64_t>(bytes, 255) == 3);
  REQUIRE(bytes.size() == first + 3 * std::size_t{length});
  // The variable length records fill the space between header and points.
  std::size_t place = 375;
  for (std::uint32_t i = 0; i < records; ++i) {
    CHECK(bytes.substr(place + 2, 9) == "LASF_Spec");
    CHECK(at<std::uint16_t>(bytes, place + 18) == 4);
    const auto content = at<std::uint16_t>(bytes, place + 20);
    for (std::size_t k = 0; k < content / 192U; ++k) {
      CHECK(at<std::uint8_t>(bytes, place + 54 + 192 * k + 2) == 9);
      CHECK(bytes.substr(place + 54 + 192 * k + 4, 2) == std::string("n") + "xyz"[k]);
    }
    place += 54U + content;
  }
  CHECK(place == first);
  const auto cloud = sample_cloud();
  double low_x = 1e9;
  double high_x = -1e9;
  for (std::size_t i = 0; i < 3; ++i) {
    const std::size_t begin = first + i * length;
    core::Vector3 p;
    for (std::size_t axis = 0; axis < 3; ++axis)
      p[static_cast<Eigen::Index>(axis)] =
          at<std::int32_t>(bytes, begin + 4 * axis) * at<double>(bytes, 131 + 8 * axis) +
          at<double>(bytes, 155 + 8 * axis);
    CHECK((p - cloud[i].position).cwiseAbs().maxCoeff() <= 0.00051);
    low_x = std::min(low_x, p.x());
    high_x = std::max(high_x, p.x());
    CHECK(at<std::uint16_t>(bytes, begin + 12) == 25'700 * i);
    CHECK(at<std::uint8_t>(bytes, begin + 14) == 0x11);
    CHECK(at<std::uint8_t>(bytes, begin + 16) == 1);
    CHECK(at<double>(bytes, begin + 22) == Approx(1'700'000'000.5 - 315'964'800.0 + 18.0 - 1e9).margin(1e-6));
    CHECK(at<float>(bytes, begin + 30 + 8) == (i == 1 ? 0.0F : 1.0F));
  }
  CHECK(at<double>(bytes, 179) == Approx(high_x).margin(1e-9));
  CHECK(at<double>(bytes, 187) == Approx(low_x).margin(1e-9));
}

TEST_CASE("an empty cloud is a valid file of every format, and the extension chooses it", "[export]") {
  for (const char* const extension : {".ply", ".pcd", ".las"}) CHECK(!encode_cloud({}, extension).empty());
  CHECK_THAT(encode_cloud({}, ".ply"), Contains("element vertex 0\n"));
  CHECK(format_of("a.las").value() == ExportFormat::kLas);
  CHECK_THAT(format_of("a.laz").error().message, Contains("a.laz") && Contains(".ply"));
  CHECK_THAT(write_cloud(sample_cloud(), "/nonexistent/map.ply").error().message,
             Contains("/nonexistent/map.ply"));
}

TEST_CASE("an export has the wall of a street at its place, and fills it at the spacing asked for",
          "[export]") {
  const tests::TemporaryFolder folder;
  const auto map = tests::street_map(folder.path() / "map");
  for (const double spacing : {0.0, 0.1}) {
    const auto points = export_map(map, spacing, folder.file("map.ply"));
    REQUIRE(points.ok());
    std::ifstream file(folder.file("map.ply"), std::ios::binary);
    const std::string bytes{std::istreambuf_iterator<char>(file), {}};
    REQUIRE(bytes.size() == mapping::kPlyHeaderBytes + *points * mapping::kPlyRowBytes);
    // The wall at y = -7.7 (tests/support/street.hpp).
    std::size_t on_wall = 0;
    for (std::size_t i = 0; i < *points; ++i) {
      const std::size_t row = mapping::kPlyHeaderBytes + i * mapping::kPlyRowBytes;
      const auto x = at<float>(bytes, row);
      const auto y = at<float>(bytes, row + 4);
      const auto z = at<float>(bytes, row + 8);
      const bool is_wall = y < -7.6F && z > 1.0F && z < 2.0F && x > 20.0F && x < 30.0F;
      if (!is_wall) continue;
      ++on_wall;
      CHECK(y == Approx(-7.7).margin(0.005));
      CHECK(at<float>(bytes, row + 16) == Approx(1.0).margin(0.01));
    }
    // 10 m of 1 m height: 40 voxels, or 1000 points.
    CHECK(on_wall == (spacing == 0.0 ? 40 : 1000));
  }
}

TEST_CASE("map.ply of a run is the export of its map, and a map that is damaged leaves what is before it",
          "[ply_file]") {
  const tests::TemporaryFolder folder;
  const auto map = tests::street_map(folder.path() / "map");
  const auto exported = export_map(map, mapping::kRunPlySpacingMetres, folder.file("export.ply"));
  REQUIRE(exported.ok());
  const auto content = [&](const char* name) {
    std::ifstream file(folder.file(name), std::ios::binary);
    return std::string{std::istreambuf_iterator<char>(file), {}};
  };
  std::ofstream(folder.file("map.ply")) << std::string(10'000'000, 'x');
  CHECK(mapping::write_ply(map, mapping::kRunPlySpacingMetres, folder.file("map.ply")).value() == *exported);
  CHECK((content("map.ply") == content("export.ply")));
  REQUIRE(map.submaps().size() > 2);
  std::filesystem::remove(mapping::submap_path(folder.path() / "map", map.submaps()[1].id));
  CHECK_THAT(mapping::write_ply(map, mapping::kRunPlySpacingMetres, folder.file("map.ply")).error().message,
             Contains("000001.sub"));
  const auto first = map.load(map.submaps()[0]);
  const std::size_t points =
      points_of(*first, map.submaps()[0].T_map_submap, mapping::kRunPlySpacingMetres).size();
  CHECK_THAT(content("map.ply"), Contains("element vertex " + std::to_string(points) + "\n"));
  CHECK(content("map.ply").size() == mapping::kPlyHeaderBytes + points * mapping::kPlyRowBytes);
  CHECK_THAT(mapping::write_ply(tests::street_map(folder.path() / "map"), 0.0, "/dev/full").error().message,
             Contains("/dev/full: cannot be written"));
  CHECK_THAT(mapping::write_ply(map, 0.0, "/nonexistent/map.ply").error().message,
             Contains("/nonexistent/map.ply: cannot be written"));
}

TEST_CASE("a path is lines of TUM or a line of GeoJSON at the origin's place", "[export]") {
  const tests::TemporaryFolder folder;
  const auto path = read_path(tests::street_map(folder.path() / "map"));
  REQUIRE(path.ok());
  REQUIRE(path->poses.size() == 90);
  REQUIRE(write_path(*path, std::nullopt, folder.file("path.tum")).ok());
  const auto read = read_trajectory(folder.file("path.tum"));
  REQUIRE(read.ok());
  CHECK(read->stamps == path->stamps);
  CHECK((read->poses[89].translation() - path->poses[89].translation()).norm() < 1e-8);
  REQUIRE(write_path(*path, gnss::GeodeticOrigin{49.0, 8.4, 115.0, 90.0}, folder.file("path.geojson")).ok());
  std::ifstream file(folder.file("path.geojson"));
  const auto places = nlohmann::json::parse(file)["features"][0]["geometry"]["coordinates"];
  REQUIRE(places.size() == 90);
  // A degree of longitude at 49 degrees north: 73,172 m.
  CHECK((places[89][0].get<double>() - places[0][0].get<double>()) * 73'172.0 == Approx(89.0).epsilon(1e-3));
  CHECK_THAT(write_path(*path, std::nullopt, folder.file("none.geojson")).error().message,
             Contains("none.geojson: ") && Contains("--origin"));
  CHECK_FALSE(write_path({}, gnss::GeodeticOrigin{}, folder.file("none.geojson")).ok());
}
