#include "nilio/drivers/capture/pcap.hpp"
#include "nilio/drivers/imu/hdl32e_imu.hpp"
#include "nilio/drivers/velodyne/clock/nmea.hpp"
#include "nilio/drivers/velodyne/clock/position_packet.hpp"

#include "tests/support/tools/simulate_room.hpp"
#include "tests/support/tools/simulate_support.hpp"
#include "tools/simulate/sensors/imu_model.hpp"
#include "tools/simulate/sensors/position_model.hpp"
#include "tools/simulate/sensors/recording.hpp"

#include <cstdint>
#include <vector>

#include <tbb/global_control.h>

using namespace nilio;
using namespace nilio::tools::simulate;
using drivers::ReturnMode;
using drivers::VelodyneModel;
using tests::RoomWorld;
using tests::TemporaryFolder;

namespace {

constexpr std::uint16_t kPositionPort = 8308;

std::vector<drivers::Packet> read_capture(const std::string& path) {
  auto source = drivers::open_pcap(path, {});
  REQUIRE(source.ok());
  std::vector<drivers::Packet> packets;
  std::vector<drivers::Packet> slots(256);
  while (true) {
    const drivers::SourceRead read = (*source)->read(slots, core::Duration{0});
    packets.insert(packets.end(), slots.begin(), slots.begin() + static_cast<std::ptrdiff_t>(read.count));
    if (read.state != drivers::SourceState::kData) return packets;
  }
}

std::vector<drivers::Packet> record(const RoomWorld& world, VelodyneModel kind,
                                    const LidarModelConfig& config, const std::string& path) {
  const LidarModel model(drivers::make_velodyne_sensor(kind), config, world.trajectory, world.scene);
  const PositionModel positions(kind, config.gps, config.T_base_lidar, model.timing(), world.trajectory);
  const auto written =
      write_lidar_recording(model, sends_position_packets(kind) ? &positions : nullptr, path);
  REQUIRE(written.ok());
  const std::vector<drivers::Packet> packets = read_capture(path);
  CHECK(packets.size() == written->packets + written->position_packets);
  return packets;
}

std::uint32_t stamp_us(const drivers::Packet& packet) {
  return drivers::decode(std::span(packet.data).first(drivers::kDataPacketSize))->timestamp_us;
}

drivers::PositionPacket position_of(const drivers::Packet& packet) {
  return *drivers::parse_position_packet(std::span(packet.data).first(packet.size));
}

core::ClockSource clock_of(const std::vector<drivers::Packet>& packets, VelodyneModel kind) {
  drivers::ScanAssembler assembler(drivers::make_velodyne_sensor(kind), {});
  for (const drivers::Packet& packet : packets) assembler.add(packet);
  return assembler.status().clock_source;
}

}  // namespace

TEST_CASE("one position packet follows every fourteenth data packet, in order of both clocks",
          "[simulate_telemetry]") {
  const RoomWorld world = tests::make_room_world(tests::room_drive(0.3));
  const TemporaryFolder folder;
  for (const VelodyneModel kind : {VelodyneModel::kVlp16, VelodyneModel::kHdl32e, VelodyneModel::kVls128}) {
    LidarModelConfig config = tests::room_config();
    config.network_jitter = core::Duration{300'000};
    const auto packets = record(world, kind, config, (folder.path() / "lidar.pcap").string());
    std::size_t data = 0;
    std::size_t positions = 0;
    std::size_t backwards = 0;
    for (std::size_t i = 0; i < packets.size(); ++i) {
      if (i > 0 && packets[i].stamp < packets[i - 1].stamp) ++backwards;
      if (packets[i].destination_port != kPositionPort) {
        ++data;
        continue;
      }
      CHECK(data == positions++ * kDataPacketsPerPosition + 1);
      const drivers::PositionPacket position = position_of(packets[i]);
      CHECK(position.timestamp_us > stamp_us(packets[i - 1]));
      if (i + 2 < packets.size()) CHECK(position.timestamp_us < stamp_us(packets[i + 2]));
    }
    CHECK(backwards == 0);
    CHECK(positions == (data + kDataPacketsPerPosition - 1) / kDataPacketsPerPosition);
  }
}

TEST_CASE("the telemetry reports the sensor's GPS state, and the decoder uses it", "[simulate_telemetry]") {
  const RoomWorld world = tests::make_room_world(tests::room_drive(0.3));
  const TemporaryFolder folder;
  const std::string path = (folder.path() / "lidar.pcap").string();
  LidarModelConfig config = tests::room_config();
  const auto first_position = [](const std::vector<drivers::Packet>& packets) {
    return position_of(*std::find_if(packets.begin(), packets.end(), [](const drivers::Packet& packet) {
      return packet.destination_port == kPositionPort;
    }));
  };
  SECTION("pulse and time") {
    // The sensor's clock is GPS time, the host's is 7 s behind it.
    config.clock_offset = core::Duration::from_seconds(7.0);
    const auto packets = record(world, VelodyneModel::kVlp16, config, path);
    const drivers::PositionPacket position = first_position(packets);
    CHECK(position.pps == drivers::PpsState::kLocked);
    const auto fix = drivers::parse_nmea(position.nmea());
    REQUIRE(fix);
    CHECK(fix->valid);
    CHECK(*fix->utc == tests::kRoomStart + core::Duration::from_seconds(6.0));
    CHECK(*fix->speed_m_s == Approx(8.0).margin(0.2));
    CHECK(clock_of(packets, VelodyneModel::kVlp16) == core::ClockSource::kPpsLocked);
  }
  SECTION("time only: the receiver's, not the sensor's") {
    config.gps = GpsReception::kNmeaOnly;
    config.clock_offset = core::Duration::from_seconds(7.0);
    const auto packets = record(world, VelodyneModel::kVlp16, config, path);
    const drivers::PositionPacket position = first_position(packets);
    CHECK(position.pps == drivers::PpsState::kAbsent);
    CHECK(*drivers::parse_nmea(position.nmea())->utc ==
          tests::kRoomStart - core::Duration::from_seconds(1.0));
    CHECK(clock_of(packets, VelodyneModel::kVlp16) == core::ClockSource::kNmeaOnly);
  }
  SECTION("nothing") {
    config.gps = GpsReception::kNone;
    config.clock_offset = core::Duration::from_seconds(7.0);
    const auto packets = record(world, VelodyneModel::kVlp16, config, path);
    const drivers::PositionPacket position = first_position(packets);
    CHECK(position.pps == drivers::PpsState::kAbsent);
    CHECK(position.nmea().empty());
    CHECK(clock_of(packets, VelodyneModel::kVlp16) == core::ClockSource::kFreeRunning);
  }
}

TEST_CASE("an RMC sentence parses to its fields, on both sides of equator and meridian",
          "[simulate_telemetry]") {
  for (const double sign : {1.0, -1.0}) {
    const RmcFields fields{core::Time{1'772'323'199'000'000'000}, sign * 49.0123, sign * 8.4567, 12.5, 271.3};
    const std::string text = format_rmc(fields);
    CHECK(text.substr(text.size() - 2) == "\r\n");
    const auto fix = drivers::parse_nmea(text);
    REQUIRE(fix);
    CHECK(fix->valid);
    CHECK(*fix->utc == fields.utc);
    CHECK(*fix->latitude_deg == Approx(fields.latitude_deg).margin(1e-6));
    CHECK(*fix->longitude_deg == Approx(fields.longitude_deg).margin(1e-6));
    CHECK(*fix->speed_m_s == Approx(12.5).margin(0.05));
    CHECK(*fix->course_deg == Approx(271.3).margin(0.05));
  }
}

TEST_CASE("an HDL-32E's boards measure the motion at the sensor", "[simulate_telemetry]") {
  const RoomWorld world = tests::make_room_world(tests::room_drive(0.5));
  const LidarModelConfig config = tests::room_config();
  const LidarModel model(drivers::make_velodyne_sensor(VelodyneModel::kHdl32e), config, world.trajectory,
                         world.scene);
  const PositionModel positions(VelodyneModel::kHdl32e, config.gps, config.T_base_lidar, model.timing(),
                                world.trajectory);
  constexpr std::uint64_t kIndex = 30;
  const auto packet = drivers::parse_position_packet(positions.make_packet(kIndex).payload);
  REQUIRE(packet);
  REQUIRE(packet->motion);
  const double time_s =
      (model.timing().last_firing(kIndex * kDataPacketsPerPosition) + model.timing().packet_period() / 2)
          .seconds();
  const TrueInertia truth = true_inertia(world.trajectory, config.T_base_lidar, time_s);
  const core::ImuSample motion = drivers::motion_of(*packet->motion);
  for (Eigen::Index i = 0; i < 3; ++i) {
    const auto k = static_cast<std::size_t>(i);
    CHECK(motion.angular_velocity[k] == Approx(truth.angular_velocity[i]).margin(0.001));
    CHECK(motion.linear_acceleration[k] == Approx(truth.specific_force[i]).margin(0.007));
  }
}

TEST_CASE("a recording has the same bytes with one or several threads", "[simulate_telemetry]") {
  const RoomWorld world = tests::make_room_world(tests::room_drive(0.1));
  const TemporaryFolder folder;
  const std::pair<VelodyneModel, ReturnMode> kinds[] = {
      {VelodyneModel::kHdl32e, ReturnMode::kDual},
      {VelodyneModel::kVls128, ReturnMode::kDualConfidence},
      {VelodyneModel::kHdl64eS1, ReturnMode::kSingle},
      {VelodyneModel::kHdl64eS3, ReturnMode::kDual},
  };
  for (const auto& [kind, mode] : kinds) {
    LidarModelConfig config = tests::room_config(mode);
    config.range_noise_m = 0.02;
    config.network_jitter = core::Duration{200'000};
    std::vector<std::string> bytes;
    for (const std::size_t threads : {1U, 2U, 4U}) {
      const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
      const auto path = folder.path() / std::to_string(threads);
      record(world, kind, config, path.string());
      bytes.push_back(tests::read_file(path));
    }
    CHECK(bytes[0].size() > 300'000);
    CHECK(bytes[0] == bytes[1]);
    CHECK(bytes[0] == bytes[2]);
    config.seed = 2;
    record(world, kind, config, (folder.path() / "other").string());
    CHECK(bytes[0] != tests::read_file(folder.path() / "other"));
  }
}

TEST_CASE("a clock 3 s off, 20 ppm fast, over a jittery network gives scans within 100 us after 10 s",
          "[simulate_telemetry]") {
  std::vector<core::SE3> stationary(272, core::SE3{{1.0, 0.0, 0.0, 0.0}, {0.0, 0.0, -1.75}});
  const RoomWorld world = tests::make_room_world(stationary);
  LidarModelConfig config = tests::room_config();
  config.gps = GpsReception::kNone;
  config.clock_offset = core::Duration::from_seconds(3.0);
  config.clock_drift_ppm = 20.0;
  config.network_jitter = core::Duration{300'000};
  const drivers::VelodyneSensor sensor = drivers::make_velodyne_sensor(VelodyneModel::kVlp16);
  const LidarModel model(sensor, config, world.trajectory, world.scene);
  drivers::ScanAssembler assembler(sensor, {});
  std::vector<core::Time> starts;
  std::vector<core::Time> true_starts;
  std::uint16_t before = 0;
  for (std::uint64_t i = 0; i < model.packet_count(); ++i) {
    const SimulatedPacket simulated = model.make_packet(i);
    const auto packet = drivers::decode(simulated.payload);
    for (std::size_t step = 0; step < drivers::kBlocksPerPacket; ++step) {
      const std::uint16_t azimuth = packet->blocks[step].azimuth;
      if (before < 18000 && azimuth >= 18000)
        true_starts.push_back(config.start + model.timing().step_time(i, step));
      before = azimuth;
    }
    if (!assembler.add(tests::as_packet(simulated.stamp, simulated.payload))) continue;
    core::Scan scan;
    assembler.take_scan(scan);
    starts.push_back(scan.start);
  }
  REQUIRE(starts.size() > 130);
  std::int64_t worst_ns = 0;
  std::size_t backwards = 0;
  for (std::size_t i = 0; i < starts.size(); ++i) {
    const std::int64_t error_ns = (starts[i] - true_starts[i]).ns;
    if ((true_starts[i] - config.start).seconds() > 10.0) worst_ns = std::max(worst_ns, std::abs(error_ns));
    if (i > 0 && starts[i] <= starts[i - 1]) ++backwards;
  }
  CHECK(worst_ns < 100'000);
  CHECK(backwards == 0);
  CHECK(assembler.status().clock_source == core::ClockSource::kFreeRunning);
  CHECK(assembler.status().clock_drift_ppm == Approx(-20.0).margin(3.0));
  INFO("largest error after 10 s: " << worst_ns << " ns");
  CHECK(worst_ns > 0);
}
