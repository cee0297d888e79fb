#include "tools/evaluate/gnss.hpp"

#include "nilio/core/units.hpp"
#include "nilio/drivers/bag/mcap_writer.hpp"

#include "tests/support/paths.hpp"
#include "tests/support/temporary_folder.hpp"
#include "tests/support/tools/run_command.hpp"
#include "tools/commands/commands.hpp"
#include "tools/common/text.hpp"
#include "tools/convert/kitti_raw.hpp"
#include "tools/gnss/georeference.hpp"
#include "tools/gnss/track.hpp"

#include <cmath>
#include <cstring>
#include <limits>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include <catch2/catch.hpp>
#include <nlohmann/json.hpp>

using namespace nilio;
using namespace nilio::tools;
using Catch::Matchers::Contains;
using gnss::Fix;
using gnss::Track;
using tests::capture_command;
using tests::read_file;
using tests::TemporaryFolder;

namespace {

constexpr std::int64_t kStartNs = 1'700'000'000'000'000'000;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

/// Fields of a ROS 2 message.
class Cdr {
 public:
  template <class T>
  Cdr& number(T value) {
    while ((bytes_.size() - 4) % sizeof(T) != 0) bytes_.push_back(0);
    bytes_.resize(bytes_.size() + sizeof(T));
    std::memcpy(bytes_.data() + bytes_.size() - sizeof(T), &value, sizeof(T));
    return *this;
  }
  Cdr& text(const std::string& value) {
    number(static_cast<std::uint32_t>(value.size() + 1));
    bytes_.insert(bytes_.end(), value.begin(), value.end());
    bytes_.push_back(0);
    return *this;
  }
  Cdr& header(std::int64_t stamp_ns) {
    return number(static_cast<std::int32_t>(stamp_ns / 1'000'000'000))
        .number(static_cast<std::uint32_t>(stamp_ns % 1'000'000'000))
        .text("gps");
  }
  [[nodiscard]] const std::vector<std::uint8_t>& bytes() const { return bytes_; }

 private:
  std::vector<std::uint8_t> bytes_{0, 1, 0, 0};
};

std::vector<std::uint8_t> nav_sat_fix(std::int64_t stamp_ns, int status, double latitude, double longitude,
                                      double altitude, double variance, int covariance_type) {
  Cdr message;
  message.header(stamp_ns).number(static_cast<std::int8_t>(status)).number(std::uint16_t{1});
  message.number(latitude).number(longitude).number(altitude);
  for (int i = 0; i < 9; ++i) message.number(i % 4 == 0 ? (i == 8 ? 4.0 : 1.0) * variance : 0.0);
  return message.number(static_cast<std::uint8_t>(covariance_type)).bytes();
}

std::string nmea(const std::string& body) {
  unsigned sum = 0;
  for (const char c : body) sum ^= static_cast<unsigned char>(c);
  return "$" + body + format("*%02X\r\n", sum);
}

/// An MCAP file of one topic.
std::string write_bag(const TemporaryFolder& folder, const std::string& name, const std::string& topic,
                      const std::string& type, const std::vector<std::vector<std::uint8_t>>& messages) {
  const std::string path = folder.file(name);
  drivers::McapWriter writer(path, {{topic, type, "x\n"}});
  for (std::size_t i = 0; i < messages.size(); ++i)
    writer.add(0, {kStartNs + static_cast<std::int64_t>(i) * 100'000'000}, messages[i]);
  writer.finish();
  REQUIRE(writer.file().write_pending() == 0);
  REQUIRE(writer.file().close() == 0);
  return path;
}

/// A figure of eight at 10 m/s and 10 Hz.
Trajectory figure_of_eight() {
  Trajectory trajectory;
  trajectory.path = "eight.tum";
  for (int i = 0; i < 600; ++i) {
    const double angle = 0.02 * i;
    const double side = std::fmod(angle, 4.0 * std::numbers::pi) < 2.0 * std::numbers::pi ? 1.0 : -1.0;
    Pose pose = Pose::Identity();
    pose.linear() = Eigen::AngleAxisd(side * angle, Eigen::Vector3d::UnitZ()).toRotationMatrix();
    pose.translation() << 50.0 * std::sin(angle), side * 50.0 * (1.0 - std::cos(angle)), 0.01 * i;
    trajectory.stamps.push_back({kStartNs + i * 100'000'000LL});
    trajectory.poses.push_back(pose);
  }
  return trajectory;
}

const gnss::GeodeticOrigin kOrigin{49.0, 8.4, 115.0, 30.0};
const Eigen::Vector3d kAntenna(-1.0, 0.5, 1.5);

/// Positions of the antenna along a trajectory at 5 Hz, with stated noise.
Track track_of(const Trajectory& trajectory, double noise_m) {
  const gnss::GeodeticFrame frame(kOrigin);
  std::mt19937 random(7);
  std::normal_distribution<double> normal(0.0, noise_m > 0.0 ? noise_m : 1.0);
  const auto noise = [&] { return noise_m > 0.0 ? normal(random) : 0.0; };
  Track track;
  track.name = "track";
  for (std::size_t i = 0; i < trajectory.poses.size(); i += 2) {
    const Eigen::Vector3d error(noise(), noise(), noise());
    const auto place = frame.geodetic(trajectory.poses[i] * kAntenna + error);
    Fix fix;
    fix.stamp = trajectory.stamps[i];
    fix.latitude_deg = place[0];
    fix.longitude_deg = place[1];
    fix.altitude_m = place[2];
    if (noise_m > 0.0) fix.deviation_m = {noise_m, noise_m, noise_m};
    track.fixes.push_back(fix);
  }
  return track;
}

gnss::GeoreferenceOptions with_antenna() {
  gnss::GeoreferenceOptions options;
  options.antenna = kAntenna;
  return options;
}

}  // namespace

TEST_CASE("metres of a local frame have the published lengths of a degree", "[geodetic]") {
  struct Degree {
    double latitude;
    double north_m;
    double east_m;
  };
  // Lengths of a degree of latitude and of longitude on WGS 84, to the metre.
  for (const Degree& degree :
       {Degree{0.0, 110574.0, 111320.0}, Degree{45.0, 111132.0, 78847.0}, Degree{60.0, 111412.0, 55800.0}}) {
    CAPTURE(degree.latitude);
    const gnss::GeodeticFrame frame({degree.latitude, 8.5, 120.0, 0.0});
    const auto origin = frame.geodetic({0.0, 0.0, 0.0});
    CHECK(origin[0] == Approx(degree.latitude).margin(1e-10));
    CHECK(origin[1] == Approx(8.5).margin(1e-10));
    CHECK(origin[2] == Approx(120.0).margin(1e-6));
    // 120 m above the ellipsoid a degree is longer by 2e-5.
    CHECK(frame.geodetic({1000.0, 0.0, 0.0})[0] - degree.latitude ==
          Approx(1000.0 / degree.north_m).epsilon(5e-5));
    CHECK(frame.geodetic({0.0, -1000.0, 0.0})[1] - 8.5 == Approx(1000.0 / degree.east_m).epsilon(5e-5));
    CHECK(frame.geodetic({0.0, 0.0, 30.0})[2] == Approx(150.0).margin(1e-6));
    const gnss::GeodeticFrame east({degree.latitude, 8.5, 120.0, 90.0});
    CHECK(east.geodetic({1000.0, 0.0, 0.0})[1] - 8.5 == Approx(1000.0 / degree.east_m).epsilon(5e-5));
    const Eigen::Vector3d place(700.0, -300.0, 20.0);
    const auto back = east.geodetic(place);
    CHECK((east.local(back[0], back[1], back[2]) - place).norm() < 1e-5);
    CHECK(east.geodetic({1000.0, 0.0, 0.0})[0] == Approx(degree.latitude).margin(2e-6));
  }
  // 100 km away the tangent plane is 780 m above the ellipsoid (d^2 / 2r).
  CHECK(gnss::GeodeticFrame({45.0, 0.0, 0.0, 0.0}).geodetic({100'000.0, 0.0, 0.0})[2] ==
        Approx(1e10 / (2.0 * 6367382.0)).epsilon(1e-3));
}

TEST_CASE("NavSatFix gives positions with their stated deviations, and none without a fix", "[gnss]") {
  const TemporaryFolder folder;
  const std::int64_t step = 100'000'000;
  const std::string bag = write_bag(folder, "fix.mcap", "/fix", "sensor_msgs/msg/NavSatFix",
                                    {nav_sat_fix(kStartNs, 0, 49.0, 8.4, 115.0, 0.25, 2),
                                     nav_sat_fix(kStartNs + step, 2, 49.0001, 8.4, 115.5, 0.0, 2),
                                     nav_sat_fix(kStartNs + 2 * step, -1, 49.0, 8.4, 115.0, 1.0, 2),
                                     nav_sat_fix(kStartNs + 3 * step, 0, kNan, kNan, kNan, 1.0, 0),
                                     nav_sat_fix(kStartNs + 4 * step, 0, 0.0, 0.0, 0.0, 1.0, 0),
                                     nav_sat_fix(kStartNs + 5 * step, 0, 91.0, 8.4, 0.0, 1.0, 0),
                                     nav_sat_fix(kStartNs, 0, 49.0, 8.4, 115.0, 1.0, 0),
                                     nav_sat_fix(kStartNs + 6 * step, 1, 49.0002, 8.4, kNan, 4.0, 0)});
  const auto track = gnss::read_track(bag);
  REQUIRE(track.ok());
  CHECK(track->without_fix == 3);
  CHECK(track->left_out == 2);
  REQUIRE(track->fixes.size() == 3);
  REQUIRE(track->fixes[0].deviation_m);
  CHECK((*track->fixes[0].deviation_m)[0] == Approx(0.5));
  CHECK((*track->fixes[0].deviation_m)[2] == Approx(1.0));
  CHECK_FALSE(track->fixes[1].deviation_m);
  CHECK(track->fixes[1].quality == "gbas");
  CHECK_FALSE(track->fixes[2].altitude_m);
  CHECK_FALSE(track->fixes[2].deviation_m);
  CHECK(gnss::track_length_m(*track) == Approx(22.24).margin(0.02));

  // The exported file is the same track.
  const std::string csv = folder.file("track.csv");
  REQUIRE(capture_command(add_convert_command, "convert gnss " + bag + " --output " + csv).status == 0);
  const auto again = gnss::read_track(csv);
  REQUIRE(again.ok());
  REQUIRE(again->fixes.size() == 3);
  for (std::size_t i = 0; i < 3; ++i) {
    CHECK(again->fixes[i].stamp == track->fixes[i].stamp);
    CHECK(again->fixes[i].latitude_deg == Approx(track->fixes[i].latitude_deg).margin(1e-10));
    CHECK(again->fixes[i].altitude_m.has_value() == track->fixes[i].altitude_m.has_value());
    CHECK(again->fixes[i].deviation_m.has_value() == track->fixes[i].deviation_m.has_value());
    CHECK(again->fixes[i].quality == track->fixes[i].quality);
  }
  const auto inspected = capture_command(add_inspect_command, "inspect " + bag);
  CHECK_THAT(inspected.output,
             Contains("GNSS /fix: 3 positions (1 fix, 1 gbas, 1 sbas), 3 messages without a fix"));
  const auto line = capture_command(add_convert_command, "convert gnss " + bag + " --to geojson");
  CHECK(nlohmann::json::parse(line.output)["features"][0]["geometry"]["coordinates"].size() == 3);
  CHECK_THAT(gnss::read_track(bag, "/gps").error().message, Contains("/fix (sensor_msgs/NavSatFix)"));
}

TEST_CASE("NMEA sentences give positions at the times of the sentences", "[gnss]") {
  const TemporaryFolder folder;
  // 22:13:20 UTC is the second of kStartNs; sentences come 0.15 s late.
  std::vector<std::vector<std::uint8_t>> messages;
  const auto add = [&](std::int64_t stamp_ns, const std::string& body) {
    messages.push_back(Cdr().header(stamp_ns).text(nmea(body)).bytes());
  };
  for (int i = 0; i < 5; ++i) {
    const std::int64_t stamp = kStartNs + i * 1'000'000'000LL + 150'000'000;
    const std::string time = "22132" + std::to_string(i) + ".00";
    add(stamp, "GPGSA,A,3,,,,,,,,,,,,,1.0,1.0,1.0");
    add(stamp, "GPRMC," + time + ",A,4900.0000,N,00824.0000,E,0.0,0.0,141123,,");
    add(stamp, "GPGGA," + time + ",4900.00" + std::to_string(i) + "0,N,00824.0000,E," + (i == 4 ? "0" : "4") +
                   ",08,0.9,67.0,M,48.0,M,,");
  }
  const auto track =
      gnss::read_track(write_bag(folder, "nmea.mcap", "/nmea", "nmea_msgs/msg/Sentence", messages));
  REQUIRE(track.ok());
  REQUIRE(track->fixes.size() == 4);
  CHECK(track->without_fix == 1);
  CHECK(track->left_out == 0);
  CHECK_FALSE(track->above_sea_level);
  for (int i = 0; i < 4; ++i) {
    const Fix& fix = track->fixes[static_cast<std::size_t>(i)];
    CHECK(fix.stamp.ns == kStartNs + i * 1'000'000'000LL);
    CHECK(fix.latitude_deg == Approx(49.0 + i * 0.001 / 60.0).margin(1e-9));
    CHECK(fix.altitude_m.value() == Approx(115.0));
    CHECK(fix.quality == "rtk");
  }
  CHECK_THAT(track->notes.front(), Contains("0.150 s later"));

  // A receiver without a model of the geoid.
  for (const char* const geoid : {"0.0", ""}) {
    messages.clear();
    for (int i = 0; i < 2; ++i)
      add(kStartNs + i * 1'000'000'000LL, "GPGGA,22132" + std::to_string(i) +
                                              ".00,4900.0000,N,00824.0000,E,1,08,0.9,67.0,M," + geoid +
                                              ",M,,");
    const auto flat = gnss::read_track(write_bag(folder, "flat" + std::string(geoid) + ".mcap", "/nmea",
                                                 "nmea_msgs/msg/Sentence", messages));
    REQUIRE(flat.ok());
    CHECK(flat->above_sea_level);
    CHECK(flat->fixes[0].altitude_m.value() == Approx(67.0));
    CHECK_THAT(flat->notes.back(), Contains("mean sea level"));
  }

  // Another clock: the times of reception.
  messages.clear();
  add(5'000'000'000, "GPRMC,221320.00,A,4900.0000,N,00824.0000,E,0.0,0.0,141123,,");
  add(6'000'000'000, "GPRMC,221321.00,A,4900.0010,N,00824.0000,E,0.0,0.0,141123,,");
  add(7'000'000'000, "GPRMC,221321.00,A,4900.0010,N,00824.00");
  const auto other =
      gnss::read_track(write_bag(folder, "boot.mcap", "/nmea", "nmea_msgs/msg/Sentence", messages));
  REQUIRE(other.ok());
  REQUIRE(other->fixes.size() == 2);
  CHECK(other->left_out == 1);
  CHECK(other->fixes[1].stamp.ns == 6'000'000'000);
  CHECK_FALSE(other->fixes[1].altitude_m);
  CHECK_THAT(other->notes.front(), Contains("times are those of reception"));
}

TEST_CASE("a trajectory is placed by positions of its antenna", "[georeference]") {
  const Trajectory trajectory = figure_of_eight();
  Track track = track_of(trajectory, 0.02);
  // Reflections: one position of ten is far off.
  for (std::size_t i = 0; i < track.fixes.size(); i += 10) track.fixes[i].latitude_deg += 5e-4;
  const auto found = gnss::georeference(trajectory, track, with_antenna());
  REQUIRE(found.ok());
  CHECK(found->origin.heading_deg == Approx(30.0).margin(0.05));
  CHECK(found->origin.latitude_deg == Approx(kOrigin.latitude_deg).margin(1e-7));
  CHECK(found->origin.longitude_deg == Approx(kOrigin.longitude_deg).margin(1e-7));
  CHECK(found->origin.altitude_m == Approx(115.0).margin(0.02));
  CHECK_FALSE(found->better_offset);
  const evaluate::GnssEvaluation evaluation = evaluate::evaluate_gnss(*found, track, {});
  CHECK(evaluation.horizontal.median < 0.03);
  CHECK(evaluation.horizontal.maximum == Approx(55.6).margin(0.5));
  CHECK(evaluation.stated_horizontal_rmse_m.value() == Approx(0.0283).margin(1e-3));
  CHECK(evaluation.positions == 300);
}

TEST_CASE("errors of a trajectory appear beside those of the receiver", "[georeference]") {
  Trajectory trajectory = figure_of_eight();
  const Track track = track_of(trajectory, 0.05);
  for (Pose& pose : trajectory.poses) pose.translation() *= 1.02;
  const auto found = gnss::georeference(trajectory, track, with_antenna());
  REQUIRE(found.ok());
  CHECK(found->scale == Approx(1.0 / 1.02).margin(2e-3));
  const evaluate::GnssEvaluation evaluation = evaluate::evaluate_gnss(*found, track, {50.0});
  REQUIRE(evaluation.all);
  // Displacements are chords of the path, so that their error is below 2 % of it.
  CHECK(evaluation.all->percent > 1.0);
  CHECK(evaluation.all->percent < 2.1);
  CHECK(evaluation.all->stated_percent.value() ==
        Approx(100.0 * 0.05 * std::sqrt(std::numbers::pi) / 50.0).epsilon(0.05));
  CHECK(evaluate::evaluate_gnss(*found, track, {5000.0}).all == std::nullopt);
}

TEST_CASE("the delay of a receiver is found where the drive shows it", "[georeference]") {
  const Trajectory trajectory = figure_of_eight();
  Track track = track_of(trajectory, 0.02);
  for (Fix& fix : track.fixes) fix.stamp.ns += 120'000'000;
  const auto found = gnss::georeference(trajectory, track, with_antenna());
  REQUIRE(found.ok());
  REQUIRE(found->better_offset);
  CHECK(found->better_offset->seconds() == Approx(-0.12).margin(0.005));
  gnss::GeoreferenceOptions options = with_antenna();
  options.time_offset = *found->better_offset;
  const auto corrected = gnss::georeference(trajectory, track, options);
  REQUIRE(corrected.ok());
  CHECK(evaluate::evaluate_gnss(*corrected, track, {}).horizontal.rmse < 0.06);
}

TEST_CASE("why a trajectory cannot be placed is named", "[georeference]") {
  const Trajectory trajectory = figure_of_eight();
  Track track = track_of(trajectory, 0.0);
  for (Fix& fix : track.fixes) fix.stamp.ns += 3'600'000'000'000;
  CHECK_THAT(gnss::georeference(trajectory, track, {}).error().message,
             Contains("0 of 300 positions") && Contains("same clock"));
  Trajectory still = trajectory;
  for (Pose& pose : still.poses) pose = Pose::Identity();
  CHECK_THAT(gnss::georeference(still, track_of(still, 0.0), {}).error().message,
             Contains("needed for a heading"));
}

TEST_CASE("nilio evaluate takes a GNSS track as truth", "[gnss]") {
  const TemporaryFolder folder;
  const Trajectory trajectory = figure_of_eight();
  const std::string csv = folder.write("gnss.csv", gnss::csv_text(track_of(trajectory, 0.02)));
  const std::string tum = folder.write("run.tum", trajectory_text(trajectory));
  const std::string antenna = " --antenna -1,0.5,1.5";
  const auto report = capture_command(add_evaluate_command, "evaluate " + csv + " " + tum + antenna);
  CHECK(report.status == 0);
  CHECK_THAT(report.output, Contains("truth       GNSS") &&
                                Contains("horizontal standard deviation 0.02 m") &&
                                Contains("clockwise from north"));
  const auto json =
      capture_command(add_evaluate_command, "evaluate " + csv + " " + tum + antenna + " --json -");
  const auto result = nlohmann::json::parse(json.output);
  CHECK(result["frame"]["heading_deg"].get<double>() == Approx(30.0).margin(0.05));
  CHECK(result["horizontal"]["rmse_m"].get<double>() < 0.04);
  CHECK(result["segments"]["translation_percent"].get<double>() < 0.03);
  // Without its lever arm the antenna is taken for base_link.
  const auto without = capture_command(add_evaluate_command, "evaluate " + csv + " " + tum + " --max-t 0.05");
  CHECK(without.status == 3);
  CHECK_THAT(without.errors, Contains("exceeds --max-t"));
  const auto aligned = capture_command(add_evaluate_command, "evaluate " + csv + " " + tum + " --align se3");
  CHECK(aligned.status == 1);
  CHECK_THAT(aligned.errors, Contains("--align: needs poses as truth"));

  // The same place by GNSS as by hand.
  const std::string by_gnss = folder.file("gnss.geojson");
  const std::string by_hand = folder.file("hand.geojson");
  REQUIRE(capture_command(add_convert_command, "convert run " + tum + " --to geojson --gnss " + csv +
                                                   antenna + " --output " + by_gnss)
              .status == 0);
  REQUIRE(capture_command(add_convert_command,
                          "convert run " + tum + " --to geojson --origin 49,8.4,115,30 --output " + by_hand)
              .status == 0);
  const auto last = [](const std::string& path) {
    return nlohmann::json::parse(read_file(path))["features"][0]["geometry"]["coordinates"][599];
  };
  for (std::size_t i = 0; i < 2; ++i)
    CHECK(last(by_gnss)[i].get<double>() == Approx(last(by_hand)[i].get<double>()).margin(1e-6));
}

TEST_CASE("positions of a real receiver agree with KITTI's projection of them", "[gnss]") {
  NILIO_REQUIRE_DATA(archive, "kitti/raw_2011_09_26_drive_0009_scans_00-50.tar.xz");
  const TemporaryFolder folder;
  REQUIRE(std::system(("tar -C " + folder.text() + " -xf " + archive.string()).c_str()) == 0);
  const auto drive = folder.path() / "2011_09_26/2011_09_26_drive_0009_sync";
  const auto raw = convert::read_kitti_raw(drive, drive);
  REQUIRE(raw.ok());
  Track track;
  for (const convert::OxtsRecord& record : raw->oxts) {
    Fix fix;
    fix.stamp = record.stamp;
    fix.latitude_deg = record.latitude_deg;
    fix.longitude_deg = record.longitude_deg;
    fix.altitude_m = record.altitude_m;
    track.fixes.push_back(fix);
  }
  // The development kit's Mercator coordinates, turned so that z is up; x is the direction of the first pose.
  const core::SE3 identity;
  Trajectory trajectory = convert::oxts_trajectory(raw->oxts, identity);
  const core::Vector3& angles = raw->oxts.front().roll_pitch_yaw;
  Pose levelled = Pose::Identity();
  levelled.linear() = (Eigen::AngleAxisd(angles.y(), core::Vector3::UnitY()) *
                       Eigen::AngleAxisd(angles.x(), core::Vector3::UnitX()))
                          .toRotationMatrix();
  for (Pose& pose : trajectory.poses) pose = levelled * pose;
  const auto found = gnss::georeference(trajectory, track, {});
  REQUIRE(found.ok());
  CHECK(found->matches.size() > 400);
  const double heading = 90.0 - angles.z() / kRadiansPerDegree;
  // The kit's projection is that of a sphere, by which north and east differ from the ellipsoid's by 0.1 to
  // 0.2 %.
  CHECK(std::remainder(found->origin.heading_deg - heading, 360.0) == Approx(0.0).margin(0.1));
  CHECK(found->origin.latitude_deg == Approx(raw->oxts.front().latitude_deg).margin(2e-7));
  CHECK(found->origin.longitude_deg == Approx(raw->oxts.front().longitude_deg).margin(2e-7));
  const evaluate::GnssEvaluation evaluation = evaluate::evaluate_gnss(*found, track, {});
  CHECK(evaluation.path_m > 300.0);
  CHECK(evaluation.horizontal.maximum < 0.002 * evaluation.path_m);
  CHECK(evaluation.vertical.value().maximum < 0.1);
}

TEST_CASE("the sentences of a real capture give its place", "[gnss]") {
  NILIO_REQUIRE_DATA(capture, "velodyne/vlp16_gps_stationary.pcap");
  const auto track = gnss::read_track(capture.string());
  REQUIRE(track.ok());
  CHECK(track->fixes.size() == 1);
  CHECK(gnss::track_length_m(*track) == 0.0);
  CHECK(std::abs(track->fixes.front().latitude_deg) > 1.0);
}
