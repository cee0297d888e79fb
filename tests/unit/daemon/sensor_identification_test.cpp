#include "daemon/input/sensor_identification.hpp"

#include "tests/support/hdl64e_packets.hpp"

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

TEST_CASE("a model that contradicts the packets is rejected with both names until packets fit",
          "[sensor_identification]") {
  SensorIdentification identification(with_model("HDL-32E"), "lidar2");
  CHECK(packets_needed(identification, vlp16_packets(100), State::kRejected) == 64);
  CHECK_THAT(identification.problem(), Contains("lidar2.model is HDL-32E") && Contains("VLP-16"));
  TurningSensor turning;
  turning.sensor = drivers::make_velodyne_sensor(drivers::VelodyneModel::kHdl32e);
  std::vector<drivers::Packet> packets;
  for (std::size_t i = 0; i < 64; ++i) packets.push_back(turning.packet(i));
  CHECK(packets_needed(identification, packets, State::kIdentified) == 64);
  CHECK(identification.take().model == drivers::VelodyneModel::kHdl32e);
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
  config.calibration = std::string(NILIO_SOURCE_DIR) + "/config/calibration/hdl64e_s2_kitti.yaml";
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
  config.calibration = std::string(NILIO_SOURCE_DIR) + "/config/calibration/hdl64e_s2_kitti.yaml";
  SensorIdentification identification(config, "lidar");
  const auto packets = hdl64e_packets(2 * kHdl64eStatusPackets, StatusStream::kWhole);
  CHECK(packets_needed(identification, packets, State::kIdentified) == 64);
  CHECK(identification.warnings().empty());
}
