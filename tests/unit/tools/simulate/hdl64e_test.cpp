#include "nilio/drivers/velodyne/hdl64e/status.hpp"

#include "tests/support/tools/simulate_room.hpp"
#include "tools/simulate/sensors/hdl64e_stream.hpp"
#include "tools/simulate/sensors/lidar_beam.hpp"

#include <numbers>
#include <vector>

using namespace nilio;
using namespace nilio::tools::simulate;
using drivers::Hdl64eStatusReader;
using drivers::ReturnMode;
using drivers::VelodyneModel;
using tests::RoomWorld;

namespace {

constexpr double kRpm = 600.0;

Hdl64eStatusReader read_stream(const Hdl64eStream& stream, std::uint64_t first, std::uint64_t count) {
  Hdl64eStatusReader reader;
  for (std::uint64_t i = first; i < first + count; ++i) {
    const core::Time clock =
        tests::kRoomStart + core::Duration{static_cast<std::int64_t>(Hdl64eStream::cycle_start(i)) * 288'000};
    const drivers::Hdl64eStatusByte byte = stream.at(i, clock);
    reader.add(byte.type, byte.value);
  }
  return reader;
}

}  // namespace

TEST_CASE("an HDL-64E sends the calibration of its simulation, rounded to the stream's steps",
          "[simulate_hdl64e]") {
  for (const VelodyneModel kind :
       {VelodyneModel::kHdl64eS2, VelodyneModel::kHdl64eS21, VelodyneModel::kHdl64eS3}) {
    const drivers::VelodyneSensor built_in = drivers::make_velodyne_sensor(kind);
    const auto stream =
        Hdl64eStream::with_calibration(built_in, ReturnMode::kSingle, kRpm, GpsReception::kLocked);
    REQUIRE(stream.ok());
    const Hdl64eStatusReader reader = read_stream(*stream, 0, 2 * drivers::kHdl64eStatusPackets);
    CHECK(reader.counters().tables == 2);
    CHECK(reader.counters().gaps + reader.counters().wrong_crc + reader.counters().implausible == 0);
    REQUIRE(reader.calibration());
    REQUIRE(stream->calibration());
    CHECK(*reader.calibration() == *stream->calibration());
    CHECK(reader.calibration()->unit.motor_rpm == 600);
    double largest_rad = 0.0;
    double largest_m = 0.0;
    for (std::size_t i = 0; i < drivers::kHdl64eLasers; ++i) {
      const drivers::LaserCalibration& sent = stream->calibration()->lasers[i];
      const drivers::LaserCalibration& own = built_in.lasers[i];
      largest_rad = std::max(largest_rad, std::abs(sent.elevation_rad - own.elevation_rad));
      largest_m = std::max(largest_m, std::abs(sent.distance_correction_m - own.distance_correction_m));
    }
    CHECK(largest_rad <= 0.00501 * std::numbers::pi / 180.0);
    CHECK(largest_m <= 0.000501);
  }
}

TEST_CASE("the stream's clock and GPS state are those of the packet's time, for packets in any order",
          "[simulate_hdl64e]") {
  struct Case {
    GpsReception gps;
    drivers::Hdl64eGps sent;
    std::int64_t clock_s;
  };
  const std::int64_t noon_s = tests::kRoomStart.ns / 1'000'000'000;
  for (const Case& c : {Case{GpsReception::kLocked, drivers::Hdl64eGps::kPulseAndTime, noon_s + 2},
                        Case{GpsReception::kNmeaOnly, drivers::Hdl64eGps::kTimeOnly, noon_s + 2},
                        Case{GpsReception::kNone, drivers::Hdl64eGps::kNone, 946'684'800 + 43'202}}) {
    // Two seconds into the drive.
    const Hdl64eStatusReader reader = read_stream(Hdl64eStream(c.gps), 6'960, 32);
    REQUIRE(reader.readings());
    CHECK(reader.readings()->gps == c.sent);
    REQUIRE(reader.readings()->clock);
    CHECK(reader.readings()->clock->ns / 1'000'000'000 == c.clock_s);
  }
}

TEST_CASE("packets of an HDL-64E contain the stream; KITTI's model sends its calibration only on request",
          "[simulate_hdl64e]") {
  const RoomWorld world = tests::make_room_world(tests::room_drive(1.3));
  LidarModelConfig config = tests::room_config();
  const auto read_packets = [&](const drivers::VelodyneSensor& sensor) {
    const LidarModel model(sensor, config, world.trajectory, world.scene);
    REQUIRE(model.packet_count() > drivers::kHdl64eStatusPackets);
    Hdl64eStatusReader reader;
    std::size_t calibration_bits = 0;
    for (std::uint64_t i = 0; i < drivers::kHdl64eStatusPackets; ++i) {
      const auto packet = drivers::decode(model.make_packet(i).payload);
      reader.add(packet->factory_byte_1, packet->factory_byte_2);
      if (i % drivers::kHdl64eStatusCycle >= 9) calibration_bits |= packet->factory_byte_2;
    }
    CHECK(reader.counters().cycles == drivers::kHdl64eStatusCycles);
    return std::pair(reader, calibration_bits);
  };
  const drivers::VelodyneSensor kitti = drivers::make_velodyne_sensor(VelodyneModel::kHdl64eS2);
  const auto [silent, silent_bits] = read_packets(kitti);
  CHECK(silent_bits == 0);
  CHECK(silent.counters().tables == 0);
  CHECK(silent.readings()->clock->ns / 1'000'000'000 == tests::kRoomStart.ns / 1'000'000'000 + 1);

  config.stream =
      Hdl64eStream::with_calibration(kitti, ReturnMode::kSingle, kRpm, GpsReception::kLocked).value();
  const auto rounded = drivers::with_stream_calibration(kitti, *config.stream->calibration());
  REQUIRE(rounded.ok());
  const auto [telling, telling_bits] = read_packets(*rounded);
  REQUIRE(telling.calibration());
  const auto decoded = drivers::with_stream_calibration(kitti, *telling.calibration());
  CHECK(decoded->lasers == rounded->lasers);
}

TEST_CASE("near an HDL-64E every range has a distance that decodes to it, except at the step at 25 m",
          "[simulate_hdl64e]") {
  const drivers::VelodyneSensor sensor = drivers::make_velodyne_sensor(VelodyneModel::kHdl64eS21);
  double worst_m = 0.0;
  double worst_at_step_m = 0.0;
  for (const drivers::LaserCalibration& laser : sensor.lasers) {
    const LidarBeam beam(laser, true);
    REQUIRE(beam.bent());
    for (double azimuth = 0.0; azimuth < 6.28; azimuth += 0.1) {
      const BeamAzimuth turn = BeamAzimuth::of(azimuth);
      for (double range = 1.6; range < 30.0; range += 0.37) {
        const core::Vector3 point = beam.point(beam.distance_for(range, turn), turn);
        const double error = std::abs((point - beam.origin(turn)).norm() - range);
        double& worst = std::abs(range - 25.04) < 0.1 ? worst_at_step_m : worst_m;
        worst = std::max(worst, error);
      }
    }
  }
  CHECK(worst_m < 1e-6);
  CHECK(worst_at_step_m < 0.1);
}

TEST_CASE("the raw intensity decodes to that of the surface within the byte's range", "[simulate_hdl64e]") {
  const drivers::VelodyneSensor sensor = drivers::make_velodyne_sensor(VelodyneModel::kHdl64eS3);
  const LidarBeam beam(sensor.lasers[0], true);
  // In focus, at 10.5 m, no correction is added.
  const double in_focus = 65535.0 * 10.5 / 131.0;
  CHECK(beam.raw_intensity(60.0, in_focus) == 60);
  CHECK(beam.raw_intensity(60.0, 20'000.0) == 0);
  CHECK(beam.raw_intensity(255.0, 8'000.0) < 255);
}
