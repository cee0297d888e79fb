#include "nilio/core/se3.hpp"
#include "nilio/drivers/capture/pcap.hpp"
#include "nilio/drivers/imu/hdl32e_imu.hpp"

#include "tests/support/paths.hpp"
#include "tests/support/replay_run.hpp"
#include "tests/support/room_drive.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <string>
#include <vector>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::tests;
using core::Vector3;

namespace {

Vector3 to_vector(const std::array<double, 3>& values) { return {values[0], values[1], values[2]}; }

/// Mean motion between two scans, measured by the LiDAR and by its own IMU; LiDAR axes.
struct Step {
  double seconds = 0.0;
  Vector3 registered_rate;
  Vector3 registered_velocity;
  Vector3 gyro;
  Vector3 force;
};

std::vector<core::ImuSample> samples_of(const std::filesystem::path& capture) {
  auto source = drivers::open_pcap(capture.string(), {});
  REQUIRE(source.ok());
  std::vector<core::ImuSample> samples;
  std::vector<drivers::Packet> packets(64);
  for (auto read = (*source)->read(packets, {}); read.state == drivers::SourceState::kData;
       read = (*source)->read(packets, {})) {
    for (const drivers::Packet& packet : std::span(packets).first(read.count)) {
      const auto position = drivers::parse_position_packet(std::span(packet.data).first(packet.size));
      if (!position || !position->motion) continue;
      samples.push_back(drivers::motion_of(*position->motion));
      samples.back().stamp = packet.stamp;
    }
  }
  return samples;
}

/// Registered without the IMU.
std::vector<Step> steps_of(const std::filesystem::path& capture) {
  daemon::Config config;
  config.imu.enabled = false;
  const ReplayRun run = run_replay(capture.string(), config);
  const std::vector<core::ImuSample> samples = samples_of(capture);
  std::vector<Step> steps;
  for (std::size_t i = 1; i < run.poses.size(); ++i) {
    const ipc::PoseRecord& a = run.poses[i - 1];
    const ipc::PoseRecord& b = run.poses[i];
    const Eigen::Quaterniond from(a.orientation_xyzw.data());
    const Eigen::Quaterniond to(b.orientation_xyzw.data());
    Step step;
    step.seconds = static_cast<double>(b.stamp_ns - a.stamp_ns) * 1e-9;
    step.registered_rate = core::so3_log(from.conjugate() * to) / step.seconds;
    step.registered_velocity =
        from.conjugate() * (to_vector(b.position) - to_vector(a.position)) / step.seconds;
    step.gyro = step.force = Vector3::Zero();
    double count = 0.0;
    for (const core::ImuSample& sample : samples) {
      if (sample.stamp.ns <= a.stamp_ns || sample.stamp.ns > b.stamp_ns) continue;
      count += 1.0;
      step.gyro += (to_vector(sample.angular_velocity) - step.gyro) / count;
      step.force += (to_vector(sample.linear_acceleration) - step.force) / count;
    }
    REQUIRE(count > 10.0);
    steps.push_back(step);
  }
  return steps;
}

Vector3 mean(const std::vector<Step>& steps, Vector3 Step::*member) {
  Vector3 sum = Vector3::Zero();
  for (const Step& step : steps) sum += step.*member;
  return sum / static_cast<double>(steps.size());
}

double correlation(const std::vector<Step>& steps, int axis) {
  const Vector3 registered = mean(steps, &Step::registered_rate);
  const Vector3 gyro = mean(steps, &Step::gyro);
  double both = 0.0;
  double a = 0.0;
  double b = 0.0;
  for (const Step& step : steps) {
    const double x = step.registered_rate[axis] - registered[axis];
    const double y = step.gyro[axis] - gyro[axis];
    both += x * y;
    a += x * x;
    b += y * y;
  }
  return both / std::sqrt(a * b);
}

/// lidar.pcap of an HDL-32E in the room whose position packets carry its motion until `imu_seconds`.
void write_hdl32e_drive(const std::filesystem::path& folder, double seconds, double imu_seconds) {
  const Room room = Room::with_pillars();
  const drivers::VelodyneSensor sensor = drivers::make_velodyne_sensor(drivers::VelodyneModel::kHdl32e);
  const std::int64_t period_ns = sensor.single().packet_period_ns;
  auto writer = drivers::PcapWriter::create((folder / "lidar.pcap").string());
  for (std::int64_t i = 0; static_cast<double>(i * period_ns) * 1e-9 < seconds; ++i) {
    const std::int64_t t = i * period_ns;
    writer->write(core::Time{kDriveStartNs + t + period_ns + 100'000}, 2368,
                  drivers::encode(room_packet(room, s_curve, sensor, t)));
    // Every 9 packets, and one of the pauses between them is short.
    if (i % 18 > 1 || static_cast<double>(t) * 1e-9 > imu_seconds) continue;
    const std::int64_t measured = t + period_ns;
    drivers::PositionPacket position;
    position.timestamp_us = static_cast<std::uint32_t>((kDriveStartNs + measured) / 1000 % 3'600'000'000);
    position.motion = drivers::boards_of(
        imu_sample(s_curve, static_cast<double>(measured) * 1e-9, Vector3(0.002, 0.001, 0.0035)), 40.0);
    writer->write(core::Time{kDriveStartNs + measured + 200'000}, 8308,
                  drivers::encode_position_packet(position));
  }
  writer->close();
}

bool has_same_poses(const ReplayRun& a, const ReplayRun& b) {
  return std::equal(a.poses.begin(), a.poses.end(), b.poses.begin(), b.poses.end(),
                    [](const ipc::PoseRecord& p, const ipc::PoseRecord& q) {
                      return p.position == q.position && p.orientation_xyzw == q.orientation_xyzw;
                    });
}

bool mentions(const ReplayRun& run, const std::string& text) {
  return std::any_of(run.notes.begin(), run.notes.end(),
                     [&](const std::string& note) { return note.find(text) != std::string::npos; });
}

}  // namespace

TEST_CASE("gyros and accelerometers of recorded HDL-32E have the axes and signs of the registration",
          "[hdl32e_imu_replay]") {
  NILIO_REQUIRE_DATA(highway, "velodyne/hdl32e_highway_moving.pcap");
  NILIO_REQUIRE_DATA(departure, "velodyne/hdl32e_monterey_stationary.pcap");
  const std::vector<Step> driving = steps_of(highway);
  const std::vector<Step> departing = steps_of(departure);
  REQUIRE(driving.size() >= 4);
  REQUIRE(departing.size() >= 15);
  // Roll and pitch of the vehicle on the highway.
  CHECK(correlation(driving, 0) > 0.7);
  CHECK(correlation(driving, 1) > 0.7);
  // The same sensor with the same zero offset four minutes later: the highway turns right.
  const double turn = mean(driving, &Step::gyro).z() - mean(departing, &Step::gyro).z();
  CAPTURE(turn);
  CHECK(turn < 0.0);
  CHECK(mean(driving, &Step::registered_rate).z() < 0.0);
  // The vehicle pulls away forwards.
  double speed = 0.0;
  for (std::size_t i = 4; i < departing.size(); ++i)
    speed += (departing[i].force.x() - mean({departing.begin(), departing.begin() + 3}, &Step::force).x()) *
             departing[i].seconds;
  CAPTURE(speed);
  CHECK(departing.back().registered_velocity.x() > 0.8);
  CHECK(speed == Approx(departing.back().registered_velocity.x()).margin(0.3));
  for (const Step& step : departing) CHECK(step.force.norm() == Approx(9.81).margin(0.5));
}

TEST_CASE("a recorded HDL-32E's own IMU covers its scans, the same with two threads", "[hdl32e_imu_replay]") {
  for (const char* name :
       {"velodyne/hdl32e_highway_moving.pcap", "velodyne/hdl32e_monterey_stationary.pcap"}) {
    NILIO_REQUIRE_DATA(capture, name);
    CAPTURE(name);
    daemon::Config config;
    const ReplayRun run = run_replay(capture.string(), config);
    CHECK(mentions(run, "IMU of the HDL-32E"));
    const daemon::OdometryCounters& counters = run.pipeline->counters();
    CHECK(counters.imu_samples.load() > 65);
    CHECK(counters.imu_refused.load() == 0);
    // Only the last scan's samples are missing: the recording ends with it.
    CHECK(counters.imu_timeouts.load() == 0);
    CHECK(run.pipeline->imu_stats().out_of_order == 0);
    CHECK(run.pipeline->imu_stats().gaps == 0);
    CHECK(run.poses.back().has_imu);
    config.odometry.threads = 2;
    CHECK(has_same_poses(run, run_replay(capture.string(), config)));
    config.imu.source = "can";
    CHECK_FALSE(run_replay(capture.string(), config).poses.back().has_imu);
  }
}

TEST_CASE("the odometry uses an HDL-32E's own IMU as one on CAN, and continues when it ends",
          "[hdl32e_imu_replay]") {
  const TemporaryFolder folder;
  constexpr double kSeconds = 6.0;
  const bool ends = GENERATE(false, true);
  write_hdl32e_drive(folder.path(), kSeconds, ends ? 4.0 : kSeconds);
  const ReplayRun run = run_replay(folder.path().string());
  CHECK(mentions(run, "IMU of the HDL-32E"));
  CHECK(run.poses.size() >= 57);
  const daemon::OdometryCounters& counters = run.pipeline->counters();
  CHECK(counters.imu_samples.load() >= (ends ? 770 : 1160));
  CHECK(scans_with_imu(run) >= (ends ? 10 : 30));
  CHECK((counters.imu_timeouts.load() > 0) == ends);
  daemon::Config config;
  config.imu.source = "hdl32e";
  CHECK(has_same_poses(run, run_replay(folder.path().string(), config)));
}
