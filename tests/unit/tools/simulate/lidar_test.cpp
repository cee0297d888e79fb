#include "nilio/core/scan.hpp"
#include "nilio/drivers/velodyne/decoder.hpp"

#include "tests/support/tools/simulate_support.hpp"
#include "tools/simulate/sensors/lidar_model.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::tools::simulate;
using core::SE3;
using core::Vector3;
using tests::SimulatedWorld;

namespace {

constexpr core::Time kStart{1'767'268'800'000'000'000};

SimulatedWorld moving_world() {
  TownDriveConfig config;
  config.moving_start = true;
  config.extent.duration_s = 0.6;
  return tests::make_world(make_town_drive(config), 1, 4);
}

LidarModelConfig lidar_config(double range_noise_m) {
  LidarModelConfig config;
  config.start = kStart;
  config.T_base_lidar.translation = {0.0, 0.0, 1.73};
  config.range_noise_m = range_noise_m;
  return config;
}

std::vector<core::Scan> decode(const LidarModel& model, const drivers::VelodyneSensor& sensor) {
  drivers::ScanAssembler assembler(sensor, {});
  std::vector<core::Scan> scans;
  for (std::uint64_t i = 0; i < model.packet_count(); ++i) {
    const SimulatedPacket simulated = model.make_packet(i);
    drivers::Packet packet;
    packet.stamp = simulated.stamp;
    packet.size = static_cast<std::uint16_t>(simulated.payload.size());
    std::copy(simulated.payload.begin(), simulated.payload.end(), packet.data.begin());
    if (assembler.add(packet)) assembler.take_scan(scans.emplace_back());
  }
  CHECK(assembler.stats().lost_packets == 0);
  CHECK(assembler.stats().firings_bad == 0);
  CHECK(assembler.stats().time_jumps == 0);
  return scans;
}

/// Error of decoded ranges against the surfaces, seen from the sensor's true place at each point's time.
std::vector<double> range_errors(const std::vector<core::Scan>& scans, const SimulatedWorld& world,
                                 const SE3& T_base_lidar) {
  std::vector<double> errors;
  for (const core::Scan& scan : scans) {
    for (std::size_t i = 0; i < scan.points.size(); i += 7) {
      const core::Point& point = scan.points[i];
      const double t = (scan.start - kStart + core::Duration{point.time_offset_ns}).seconds();
      const SE3 T_world_lidar = world.trajectory.pose(t) * T_base_lidar;
      const Vector3 p(point.x, point.y, point.z);
      const auto hit =
          tests::cast_rays(world.scene, {{T_world_lidar.translation, T_world_lidar.rotation * p}}, t, 150.0F);
      if (hit[0] > 0.0F) errors.push_back(p.norm() - static_cast<double>(hit[0]));
    }
  }
  return errors;
}

double quantile_of_size(std::vector<double> errors, double share) {
  for (double& error : errors) error = std::abs(error);
  const auto index = static_cast<std::ptrdiff_t>(share * static_cast<double>(errors.size() - 1));
  std::nth_element(errors.begin(), errors.begin() + index, errors.end());
  return errors[static_cast<std::size_t>(index)];
}

}  // namespace

TEST_CASE("decoded points lie on the surfaces, each seen from the pose at its own time", "[simulate_lidar]") {
  const SimulatedWorld world = moving_world();
  for (const auto kind : {drivers::VelodyneModel::kVlp16, drivers::VelodyneModel::kHdl64eS2}) {
    const drivers::VelodyneSensor sensor = drivers::make_velodyne_sensor(kind);
    const LidarModelConfig config = lidar_config(0.0);
    const auto scans = decode(LidarModel(sensor, config, world.trajectory, world.scene), sensor);
    REQUIRE(scans.size() >= 4);
    CHECK(scans[1].coverage_deg > 355.0F);
    const auto errors = range_errors(scans, world, config.T_base_lidar);
    REQUIRE(errors.size() > 2000);
    // Half of the range resolution, and azimuths rounded by half of 0.01 degree on slanting walls.
    CHECK(quantile_of_size(errors, 0.5) < 0.0015);
    CHECK(quantile_of_size(errors, 0.95) < 0.02);
  }
}

TEST_CASE("ranges scatter by the configured noise", "[simulate_lidar]") {
  const SimulatedWorld world = moving_world();
  const drivers::VelodyneSensor sensor = drivers::make_velodyne_sensor(drivers::VelodyneModel::kVlp16);
  const LidarModelConfig config = lidar_config(0.03);
  const auto scans = decode(LidarModel(sensor, config, world.trajectory, world.scene), sensor);
  const auto errors = range_errors(scans, world, config.T_base_lidar);
  REQUIRE(errors.size() > 2000);
  CHECK(1.4826 * quantile_of_size(errors, 0.5) == Approx(0.03).epsilon(0.08));
}

TEST_CASE("packets contain the model's bytes, their own time and the rotation rate", "[simulate_lidar]") {
  const SimulatedWorld world = moving_world();
  const drivers::VelodyneSensor sensor = drivers::make_velodyne_sensor(drivers::VelodyneModel::kVlp16);
  const LidarModel model(sensor, lidar_config(0.02), world.trajectory, world.scene);
  const SimulatedPacket simulated = model.make_packet(3);
  const auto packet = drivers::decode(simulated.payload);
  REQUIRE(packet);
  CHECK(packet->factory_byte_1 == 0x37);
  CHECK(packet->factory_byte_2 == 0x22);
  // Third packet period of 1327.104 us, whole microseconds past the hour (12:00:00).
  CHECK(packet->timestamp_us == 3981);
  CHECK((simulated.stamp - kStart).ns == 3'981'000 + 1'306'368 + 100'000);
  CHECK(packet->blocks[0].azimuth == 1433);
  const int advance = packet->blocks[11].azimuth - packet->blocks[0].azimuth;
  CHECK(advance == Approx(11 * 39.813).margin(1.0));
}

TEST_CASE("packets depend only on seed and index, not on earlier packets", "[simulate_lidar]") {
  const SimulatedWorld world = moving_world();
  const SimulatedWorld again = moving_world();
  const drivers::VelodyneSensor sensor = drivers::make_velodyne_sensor(drivers::VelodyneModel::kVlp16);
  LidarModelConfig config = lidar_config(0.02);
  const LidarModel first(sensor, config, world.trajectory, world.scene);
  const LidarModel second(sensor, config, again.trajectory, again.scene);
  config.seed = 2;
  const LidarModel other(sensor, config, world.trajectory, world.scene);
  const std::uint64_t count = first.packet_count();
  REQUIRE(count > 400);
  using Payload = decltype(SimulatedPacket::payload);
  std::vector<Payload> backwards;
  for (std::uint64_t i = count; i-- > 0;) backwards.push_back(second.make_packet(i).payload);
  for (std::uint64_t i = 0; i < count; ++i) {
    const Payload payload = first.make_packet(i).payload;
    CHECK(payload == backwards[count - 1 - i]);
    CHECK(payload != other.make_packet(i).payload);
  }
}
