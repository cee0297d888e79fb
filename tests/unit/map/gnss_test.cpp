#include "tools/map/gnss.hpp"

#include "tests/support/temporary_folder.hpp"
#include "tools/map/close.hpp"
#include "tools/map/edit.hpp"
#include "tools/map/export.hpp"

#include <cmath>
#include <fstream>
#include <functional>
#include <iterator>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include <catch2/catch.hpp>
#include <nlohmann/json.hpp>

#include "mapping/map_folder.hpp"

namespace {

using namespace nilio;
using namespace nilio::tools;
using namespace nilio::tools::map;
using Catch::Matchers::Contains;
using core::SE3;
using core::Vector3;
using mapping::MapReader;

constexpr std::int64_t kStartNs = 1'700'000'000'000'000'000;
constexpr std::int64_t kStepNs = 200'000'000;
const gnss::GeodeticOrigin kOrigin{49.0, 8.4, 160.0, 37.0};
const Vector3 kAntenna(-0.4, 0.3, 1.8);

/// A drive of bends and straights with a keyframe each metre, and its odometry, which turns by 0.5 deg in
/// 100 m, every kilometre the other way, and climbs by 0.2 m in 100 m.
struct Drive {
  std::vector<core::Time> stamps;
  std::vector<SE3> truth;
  std::vector<SE3> odometry;
};

Drive bends(int metres) {
  Drive drive;
  SE3 truth;
  SE3 odometry;
  for (int i = 0; i < metres; ++i) {
    drive.stamps.push_back({kStartNs + i * kStepNs});
    drive.truth.push_back(truth);
    drive.odometry.push_back(odometry);
    const double turn = 0.03 * std::sin(0.02 * i);
    truth = truth * SE3{core::so3_exp({0.0, 0.0, turn}), {1.0, 0.0, 0.0}};
    const double drift = (i / 1000 % 2 == 0 ? 0.5 : -0.5) / 57.3 / 100.0;
    odometry = odometry * SE3{core::so3_exp({0.0, 0.0, turn + drift}), {1.0, 0.0, 0.002}};
  }
  return drive;
}

/// Submaps of 50 m, half of which is the next one's, with the road as their only surface.
void write_map(const Drive& drive, const std::filesystem::path& folder) {
  auto writer = mapping::MapWriter::open(folder, "test", {1});
  REQUIRE(writer.ok());
  for (std::size_t begin = 0; begin + 50 <= drive.odometry.size(); begin += 25) {
    mapping::Submap submap;
    submap.id = static_cast<std::uint32_t>(begin / 25);
    submap.T_odom_submap.translation = drive.odometry[begin + 25].translation.array().round();
    for (std::size_t i = begin; i < begin + 50; ++i)
      submap.keyframes.push_back({drive.stamps[i], submap.T_odom_submap.inverse() * drive.odometry[i], {}});
    mapping::Surface road;
    road.mean = {0.25F, 0.25F, 0.0F};
    road.points = 10;
    road.is_plane = true;
    submap.surfaces.push_back(road);
    submap.minimum = submap.maximum = road.mean;
    REQUIRE(writer->write(submap, {2}).ok());
  }
}

/// The antenna's true places, one in two seconds, moved by `error` (m, east, north and up) of their number.
GnssInput receive(const Drive& drive, const std::function<Vector3(int)>& error, bool has_altitude = true) {
  GnssInput input;
  input.options.antenna = kAntenna;
  input.track.name = "track.csv";
  const gnss::GeodeticFrame truth(kOrigin);
  const gnss::GeodeticFrame earth({kOrigin.latitude_deg, kOrigin.longitude_deg, kOrigin.altitude_m, 90.0});
  for (std::size_t i = 0; i < drive.truth.size(); i += 10) {
    const auto place = truth.geodetic(drive.truth[i] * kAntenna);
    const Vector3 east_north_up = earth.local(place[0], place[1], place[2]) + error(static_cast<int>(i / 10));
    const auto [latitude, longitude, altitude] = earth.geodetic(east_north_up);
    gnss::Fix fix;
    fix.stamp = drive.stamps[i];
    fix.latitude_deg = latitude;
    fix.longitude_deg = longitude;
    if (has_altitude) fix.altitude_m = altitude;
    fix.deviation_m = {1.0, 1.0, 2.0};
    input.track.fixes.push_back(fix);
  }
  return input;
}

Vector3 exact(int) { return Vector3::Zero(); }

/// Errors with a deviation of 1 m, half of it the same for 20 s.
std::function<Vector3(int)> noisy(std::uint32_t seed) {
  return [random = std::mt19937(seed), normal = std::normal_distribution<double>(),
          slow = Vector3(0, 0, 0)](int i) mutable {
    const auto draw = [&] { return Vector3(normal(random), normal(random), 2.0 * normal(random)); };
    if (i % 10 == 0) slow = draw();
    return Vector3(0.7 * slow + 0.7 * draw());
  };
}

struct Errors {
  double horizontal_m = 0.0;
  double height_m = 0.0;
};

/// Distance of the map's path on the earth from the truth: root mean square, and maximum of the height.
Errors errors_of(const MapReader& map, const Drive& drive, const mapping::Datum& datum) {
  const auto path = read_path(map);
  REQUIRE(path.ok());
  const gnss::GeodeticFrame frame(origin_of(datum));
  const gnss::GeodeticFrame truth(kOrigin);
  double square = 0.0;
  Errors errors;
  for (std::size_t i = 0; i < path->poses.size(); ++i) {
    const auto [latitude, longitude, altitude] = frame.geodetic(path->poses[i].translation());
    const Vector3 error = truth.local(latitude, longitude, altitude) - drive.truth[i].translation;
    square += error.head<2>().squaredNorm();
    errors.height_m = std::max(errors.height_m, std::abs(error.z()));
  }
  errors.horizontal_m = std::sqrt(square / static_cast<double>(path->poses.size()));
  return errors;
}

MapReader open(const std::filesystem::path& folder) {
  auto map = MapReader::open(folder);
  REQUIRE(map.ok());
  CHECK(map->warning().empty());
  return std::move(map).value();
}

std::string bytes_of(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

}  // namespace

TEST_CASE("a map that has drifted follows the positions of its antenna, and knows its place", "[gnss]") {
  const tests::TemporaryFolder folder;
  const Drive drive = bends(3000);
  const auto path = folder.path() / "map";
  write_map(drive, path);
  const MapReader odometry = open(path);
  for (const bool has_altitude : {true, false}) {
    const auto closed = close(path, receive(drive, exact, has_altitude));
    REQUIRE(closed.ok());
    CHECK(closed->gnss->positions.size() == closed->ids.size());
    CHECK(closed->gnss_rms_m < 1.0);
    const MapReader map = open(path);
    const Errors errors = errors_of(map, drive, map.gnss()->datum);
    const Errors before = errors_of(odometry, drive, map.gnss()->frame);
    INFO(before.horizontal_m << " to " << errors.horizontal_m << " m");
    CHECK(before.horizontal_m > 3.0);
    CHECK(errors.horizontal_m < 0.25 * before.horizontal_m);
    if (has_altitude) CHECK(errors.height_m < 0.4);
    CHECK(std::abs(map.gnss()->datum.heading_deg - kOrigin.heading_deg) < 2.0);
    CHECK(map.gnss()->altitude ==
          (has_altitude ? mapping::AltitudeReference::kEllipsoid : mapping::AltitudeReference::kNone));
  }
  for (const std::uint32_t seed : {1U, 2U, 3U}) {
    // Reflections for a minute, jumps of 30 m.
    const auto bad = [noise = noisy(seed)](int i) mutable {
      const Vector3 error = noise(i);
      if (i >= 40 && i < 60) return Vector3(error + Vector3(14.0, 8.0, 5.0));
      if (i % 9 == 4) return Vector3(error + Vector3(0.0, 30.0, 0.0));
      return error;
    };
    REQUIRE(close(path, receive(drive, bad)).ok());
    const MapReader map = open(path);
    const Errors errors = errors_of(map, drive, map.gnss()->datum);
    INFO("seed " << seed);
    CHECK(errors.horizontal_m < 1.5);
    CHECK(errors.horizontal_m < 0.5 * errors_of(odometry, drive, map.gnss()->frame).horizontal_m);
    CHECK(errors.height_m < 4.0);
  }
}

TEST_CASE("positions of a map stay with it: closed again it has the same bytes, parts keep its place",
          "[gnss]") {
  const tests::TemporaryFolder folder;
  const Drive drive = bends(500);
  const auto path = folder.path() / "map";
  write_map(drive, path);
  REQUIRE(close(path).ok());
  const std::string without = bytes_of(path / "poses");
  REQUIRE(close(path, receive(drive, noisy(7))).ok());
  const std::string with = bytes_of(path / "poses");
  CHECK(with.size() > without.size());
  REQUIRE(close(path).ok());
  CHECK((bytes_of(path / "poses") == with));
  std::filesystem::remove(path / "poses");
  REQUIRE(close(path, receive(drive, noisy(7))).ok());
  CHECK((bytes_of(path / "poses") == with));
  // Any damage is found.
  for (std::size_t at = without.size() - 4; at < with.size(); at += 37) {
    std::string damaged = with;
    damaged[at] = static_cast<char>(damaged[at] ^ 0x10);
    std::ofstream(path / "poses", std::ios::binary) << damaged;
    CHECK_THAT(MapReader::open(path)->warning(), Contains("damaged"));
    std::ofstream(path / "poses", std::ios::binary) << with.substr(0, at);
    CHECK_THAT(MapReader::open(path)->warning(), Contains("damaged"));
  }
  std::ofstream(path / "poses", std::ios::binary) << with;

  const MapReader map = open(path);
  const mapping::Datum& datum = map.gnss()->datum;
  REQUIRE(crop(map, {{-1e4, -1e4, -1e3}, {1e4, 100.0, 1e3}}, folder.path() / "near").ok());
  REQUIRE(crop(map, {{-1e4, 100.0, -1e3}, {1e4, 1e4, 1e3}}, folder.path() / "far").ok());
  REQUIRE(merge({open(folder.path() / "near"), open(folder.path() / "far")}, folder.path() / "both").ok());
  for (const char* const part : {"near", "far", "both"}) {
    REQUIRE(close(folder.path() / part).ok());
    const MapReader cropped = open(folder.path() / part);
    REQUIRE(cropped.gnss().has_value());
    CHECK(cropped.gnss()->datum.latitude_deg == datum.latitude_deg);
    CHECK(cropped.gnss()->datum.heading_deg == datum.heading_deg);
    CHECK(cropped.gnss()->positions.empty());
  }
  // A map of another place.
  const auto other = folder.path() / "other";
  write_map(drive, other);
  REQUIRE(close(other, receive(drive, [](int) { return Vector3(500.0, 0.0, 0.0); })).ok());
  CHECK_THAT(merge({open(path), open(other)}, folder.path() / "none").error().message,
             Contains("different places"));
}

TEST_CASE("the path of a map with a place is a line of GeoJSON or KML there", "[gnss]") {
  const tests::TemporaryFolder folder;
  const Drive drive = bends(200);
  write_map(drive, folder.path() / "map");
  REQUIRE(close(folder.path() / "map", receive(drive, exact)).ok());
  const MapReader map = open(folder.path() / "map");
  const auto path = read_path(map);
  REQUIRE(path.ok());
  for (const char* const name : {"path.geojson", "path.kml"})
    REQUIRE(write_path(*path, origin_of(map.gnss()->datum), folder.file(name)).ok());
  const auto line = nlohmann::json::parse(bytes_of(folder.file("path.geojson")))["features"][0]["geometry"];
  const std::string kml = bytes_of(folder.file("path.kml"));
  CHECK_THAT(kml, Contains("<altitudeMode>clampToGround</altitudeMode>") && Contains("</kml>"));
  double longitude = 0.0;
  double latitude = 0.0;
  const std::string begin = "<coordinates>\n";
  REQUIRE(std::sscanf(kml.c_str() + kml.find(begin) + begin.size(), "%lf,%lf", &longitude, &latitude) == 2);
  CHECK(std::abs(line["coordinates"][0][0].get<double>() - longitude) < 1e-9);
  CHECK(std::abs(line["coordinates"][0][1].get<double>() - latitude) < 1e-9);
  CHECK(std::abs(latitude - kOrigin.latitude_deg) * 111'200.0 < 0.3);
  CHECK_THAT(write_path(*path, std::nullopt, folder.file("path.kml")).error().message,
             Contains("--origin") && Contains("--gnss"));
}

TEST_CASE("positions that cannot place a map are refused, and leave it as it is", "[gnss]") {
  const tests::TemporaryFolder folder;
  const Drive drive = bends(600);
  const auto path = folder.path() / "map";
  write_map(drive, path);
  REQUIRE(close(path).ok());
  const std::string before = bytes_of(path / "poses");
  const auto refused = [&](const GnssInput& input) {
    const auto closed = close(path, input);
    REQUIRE_FALSE(closed.ok());
    CHECK((bytes_of(path / "poses") == before));
    return closed.error().message;
  };
  GnssInput shorter = receive(drive, exact);
  shorter.track.fixes.resize(5);
  CHECK_THAT(refused(shorter), Contains("track.csv: positions along 40 m of the map's path") &&
                                   Contains("50 m and 20 m are needed"));
  GnssInput later = receive(drive, exact);
  for (gnss::Fix& fix : later.track.fixes) fix.stamp.ns += 3'600'000'000'000;
  CHECK_THAT(refused(later), Contains("0 of 60 positions of track.csv") && Contains("the same clock"));
  // Another drive of the same time.
  const auto elsewhere = [](int i) {
    return Vector3(90.0 * std::sin(1.7 * i), 90.0 * std::cos(2.3 * i), 0.0);
  };
  CHECK_THAT(refused(receive(drive, elsewhere)), Contains("positions of GNSS agree with the map"));
  // A wrong antenna is an error of its size.
  GnssInput wrong = receive(drive, noisy(3));
  wrong.options.antenna = {1.6, 0.3, 1.8};
  REQUIRE(close(path, wrong).ok());
  const MapReader map = open(path);
  CHECK(errors_of(map, drive, map.gnss()->datum).horizontal_m < 3.0);
}
