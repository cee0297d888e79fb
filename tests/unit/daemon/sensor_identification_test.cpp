#include "daemon/input/sensor_identification.hpp"

#include "tests/support/disturbed_packets.hpp"
#include "tests/support/hdl64e_packets.hpp"
#include "tests/support/paths.hpp"

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::daemon;
using namespace nilio::tests;
using Catch::Matchers::Contains;
using drivers::kHdl64eStatusPackets;

namespace {

using State = SensorIdentification::State;

/// Number of packets until a decision; all of them without one.
std::size_t packets_needed(SensorIdentification& identification, const std::vector<drivers::Packet>& packets,
                           State expected) {
  for (std::size_t i = 0; i < packets.size(); ++i) {
    const State state = identification.add(packets[i]);
    if (state == State::kUndecided) continue;
    CHECK(state == expected);
    return i + 1;
  }
  return packets.size();
}

LidarConfig with_model(const std::string& model) {
  LidarConfig config;
  config.model = model;
  return config;
}

}  // namespace

TEST_CASE("64 packets identify the model, fewer at the end of a recording", "[sensor_identification]") {
  SensorIdentification identification(LidarConfig{}, "lidar");
  CHECK(packets_needed(identification, vlp16_packets(100), State::kIdentified) == 64);
  CHECK(identification.take().model == drivers::VelodyneModel::kVlp16);
  REQUIRE(identification.notes().size() == 1);
  CHECK(identification.notes()[0] == "LiDAR VLP-16 (from the packets)");

  SensorIdentification at_end(LidarConfig{}, "lidar");
  CHECK(packets_needed(at_end, vlp16_packets(20), State::kIdentified) == 20);
  REQUIRE(at_end.finish() == State::kIdentified);
  CHECK(at_end.take().model == drivers::VelodyneModel::kVlp16);
}

TEST_CASE("packets of other lengths are not used for identification", "[sensor_identification]") {
  SensorIdentification identification(LidarConfig{}, "lidar");
  drivers::Packet other;
  other.size = 512;
  for (int i = 0; i < 200; ++i) REQUIRE(identification.add(other) == State::kUndecided);
  CHECK(packets_needed(identification, vlp16_packets(100), State::kIdentified) == 64);
}

TEST_CASE("a configured model is used although the packets contradict it, with a warning that names both",
          "[sensor_identification]") {
  SensorIdentification identification(with_model("HDL-32E"), "lidar2");
  CHECK(packets_needed(identification, vlp16_packets(100), State::kIdentified) == 64);
  CHECK(identification.take().model == drivers::VelodyneModel::kHdl32e);
  REQUIRE(identification.warnings().size() == 1);
  CHECK_THAT(identification.warnings()[0], Contains("lidar2.model is HDL-32E") && Contains("VLP-16"));
}

TEST_CASE("an early VLP-16 is never refused, and uncertain without the configuration",
          "[sensor_identification]") {
  std::vector<drivers::Packet> packets = vlp16_packets(200);
  for (drivers::Packet& packet : packets) packet.data[1205] = 0x21;
  for (const Disturbance& how : disturbances()) {
    for (const std::uint32_t seed : {1U, 2U, 3U}) {
      INFO(how.name << " seed " << seed);
      const auto disturbed = disturb(packets, how, seed);
      SensorIdentification set(with_model("VLP-16"), "lidar");
      packets_needed(set, disturbed, State::kIdentified);
      CHECK(set.take().model == drivers::VelodyneModel::kVlp16);
      CHECK(set.warnings().empty());
      SensorIdentification open(LidarConfig{}, "lidar");
      packets_needed(open, disturbed, State::kIdentified);
      CHECK(open.take().model == drivers::VelodyneModel::kVlp16);
      REQUIRE(open.warnings().size() == 1);
      CHECK_THAT(open.warnings()[0], Contains("uncertain") && Contains("Puck-Hi-Res") &&
                                         Contains("decoded as VLP-16") && Contains("set lidar.model"));
    }
  }
}

TEST_CASE("a return mode that the packets do not have is an error that names both",
          "[sensor_identification]") {
  LidarConfig config;
  config.return_mode = "dual";
  for (const char* model : {"auto", "VLP-16"}) {
    config.model = model;
    SensorIdentification identification(config, "lidar");
    CHECK(packets_needed(identification, vlp16_packets(100), State::kRejected) == 64);
    CHECK_THAT(identification.problem(),
               Contains("lidar.return_mode is dual") && Contains("single returns") && Contains("auto"));
  }
  config.model = "HDL-64E-S2";
  const auto checked = check_lidar(config, "lidar");
  REQUIRE_FALSE(checked.ok());
  CHECK_THAT(checked.error().message, Contains("return_mode is dual") && Contains("HDL-64E-S2"));
}

TEST_CASE("a configured sensor needs no packets, an HDL-64E only with its calibration",
          "[sensor_identification]") {
  CHECK_FALSE(configured_sensor(LidarConfig{}).has_value());
  REQUIRE(configured_sensor(with_model("VLP-16")).has_value());
  CHECK(configured_sensor(with_model("VLP-16"))->model == drivers::VelodyneModel::kVlp16);
  LidarConfig hdl64e = with_model("HDL-64E-S2");
  CHECK_FALSE(configured_sensor(hdl64e).has_value());
  hdl64e.calibration = source_folder() + "/config/calibration/hdl64e_s2_kitti.yaml";
  CHECK(configured_sensor(hdl64e).has_value());
}

TEST_CASE("an HDL-64E S2 is no S1, and its stream is read from duplicated and reordered packets",
          "[sensor_identification]") {
  const drivers::Hdl64eCalibration sent = make_writer().calibration();
  const auto packets = hdl64e_packets(3 * kHdl64eStatusPackets, StatusStream::kWhole, 100);
  for (const Disturbance& how : disturbances()) {
    INFO(how.name);
    SensorIdentification identification(LidarConfig{}, "lidar");
    State state = State::kUndecided;
    for (const drivers::Packet& packet : disturb(packets, how, 3)) {
      state = identification.add(packet);
      if (state != State::kUndecided) break;
    }
    if (state == State::kUndecided) state = identification.finish();
    REQUIRE(state == State::kIdentified);
    const drivers::VelodyneSensor sensor = identification.take();
    CHECK(sensor.model == drivers::VelodyneModel::kHdl64eS2);
    // Lost packets are missing from every pass.
    const bool is_whole = how.lost == 0.0;
    CHECK((sensor.lasers[7].elevation_rad == sent.lasers[7].elevation_rad) == is_whole);
    CHECK(identification.warnings().size() == (is_whole ? 0 : 1));
  }
}

TEST_CASE("an ambiguous model requires the configuration", "[sensor_identification]") {
  TurningSensor turning;
  turning.sensor = drivers::make_velodyne_sensor(drivers::VelodyneModel::kVlp32b);
  std::vector<drivers::Packet> packets;
  for (std::size_t i = 0; i < 64; ++i) packets.push_back(turning.packet(i));
  SensorIdentification open(LidarConfig{}, "lidar");
  packets_needed(open, packets, State::kRejected);
  CHECK_THAT(open.problem(), Contains("VLP-32A or VLP-32B") && Contains("lidar.model"));
  SensorIdentification set(with_model("VLP-32B"), "lidar");
  packets_needed(set, packets, State::kIdentified);
  CHECK(set.take().model == drivers::VelodyneModel::kVlp32b);
}

TEST_CASE("a calibration file of another sensor is rejected", "[sensor_identification]") {
  LidarConfig config;
  config.calibration = source_folder() + "/config/calibration/hdl64e_s2_kitti.yaml";
  SensorIdentification identification(config, "lidar");
  packets_needed(identification, vlp16_packets(64), State::kRejected);
  CHECK_THAT(identification.problem(), Contains("hdl64e_s2_kitti.yaml"));
}

TEST_CASE("the calibration transmitted by an HDL-64E is used wherever its stream is joined",
          "[sensor_identification]") {
  const drivers::Hdl64eCalibration sent = make_writer().calibration();
  for (const std::size_t first :
       {std::size_t{0}, std::size_t{1}, std::size_t{2000}, kHdl64eStatusPackets - 1}) {
    SensorIdentification identification(LidarConfig{}, "lidar");
    const auto packets = hdl64e_packets(2 * kHdl64eStatusPackets, StatusStream::kWhole, first);
    const std::size_t needed = packets_needed(identification, packets, State::kIdentified);
    CHECK(needed == (first == 0 ? kHdl64eStatusPackets : 2 * kHdl64eStatusPackets - first));
    const drivers::VelodyneSensor sensor = identification.take();
    for (std::size_t i = 0; i < drivers::kHdl64eLasers; ++i) {
      REQUIRE(sensor.lasers[i].elevation_rad == sent.lasers[i].elevation_rad);
      REQUIRE(sensor.lasers[i].distance_correction_m == sent.lasers[i].distance_correction_m);
    }
    REQUIRE(identification.notes().size() == 1);
    CHECK_THAT(identification.notes()[0], Contains("its own status stream") && Contains("2023-11-14"));
    CHECK(identification.warnings().empty());
  }
}

TEST_CASE("after a gap in the first pass the second pass is used", "[sensor_identification]") {
  auto packets = hdl64e_packets(2 * kHdl64eStatusPackets + 1, StatusStream::kWhole);
  packets.erase(packets.begin() + 1000);
  SensorIdentification identification(LidarConfig{}, "lidar");
  CHECK(packets_needed(identification, packets, State::kIdentified) == 2 * kHdl64eStatusPackets - 1);
  CHECK_THAT(identification.notes().front(), Contains("its own status stream"));
}

TEST_CASE("a status stream without a table ends the search after one pass", "[sensor_identification]") {
  SensorIdentification identification(LidarConfig{}, "lidar");
  const auto packets = hdl64e_packets(2 * kHdl64eStatusPackets, StatusStream::kWithoutTable, 5);
  CHECK(packets_needed(identification, packets, State::kIdentified) == kHdl64eStatusPackets);
  const drivers::VelodyneSensor built_in = drivers::make_velodyne_sensor(drivers::VelodyneModel::kHdl64eS2);
  CHECK(identification.take().lasers == built_in.lasers);
  REQUIRE(identification.warnings().size() == 1);
  CHECK_THAT(identification.warnings()[0],
             Contains("lidar.calibration") && Contains("db.xml") && Contains("--write-calibration"));
}

TEST_CASE("a calibration with a wrong checksum is rejected with a warning", "[sensor_identification]") {
  SensorIdentification identification(LidarConfig{}, "lidar");
  const auto packets = hdl64e_packets(2 * kHdl64eStatusPackets + 100, StatusStream::kWrongChecksum);
  CHECK(packets_needed(identification, packets, State::kIdentified) == 2 * kHdl64eStatusPackets);
  const drivers::VelodyneSensor built_in = drivers::make_velodyne_sensor(drivers::VelodyneModel::kHdl64eS2);
  CHECK(identification.take().lasers == built_in.lasers);
  REQUIRE(identification.warnings().size() == 1);
  CHECK_THAT(identification.warnings()[0], Contains("checksum"));
}

TEST_CASE("a calibration file takes precedence over the status stream and needs no wait",
          "[sensor_identification]") {
  LidarConfig config;
  config.calibration = source_folder() + "/config/calibration/hdl64e_s2_kitti.yaml";
  SensorIdentification identification(config, "lidar");
  const auto packets = hdl64e_packets(2 * kHdl64eStatusPackets, StatusStream::kWhole);
  CHECK(packets_needed(identification, packets, State::kIdentified) == 64);
  CHECK(identification.warnings().empty());
}
