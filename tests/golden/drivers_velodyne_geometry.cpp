#include "nilio/drivers/velodyne_decoder.hpp"
#include "nilio/drivers/velodyne_packet.hpp"

#include "../unit/drivers_support.hpp"

#include <numbers>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::drivers;
using nilio::tests::TurningSensor;

namespace {

/// Everything the packet holds, in one partial scan.
core::Scan decode_one(const VelodyneSensor& sensor, const VelodyneDataPacket& data) {
  ScanAssembler assembler(sensor, {.min_coverage = 0.0});
  Packet packet = TurningSensor::wrap(data);
  packet.stamp.ns = nilio::tests::kEpochNs;
  REQUIRE_FALSE(assembler.add(packet));
  REQUIRE(assembler.finish());
  core::Scan scan;
  assembler.take_scan(scan);
  return scan;
}

void require_point(const core::Point& point, double x, double y, double z, int time_ns) {
  CHECK(point.x == Approx(x).margin(2e-5));
  CHECK(point.y == Approx(y).margin(2e-5));
  CHECK(point.z == Approx(z).margin(2e-5));
  CHECK(point.time_offset_ns == time_ns);
}

VelodyneDataPacket empty_packet(const VelodyneSensor& sensor, int first_azimuth, int step) {
  VelodyneDataPacket data;
  for (std::size_t b = 0; b < kBlocksPerPacket; ++b) {
    data.blocks[b].flag = sensor.single().block_flags[b];
    data.blocks[b].azimuth = static_cast<std::uint16_t>(
        first_azimuth + step * static_cast<int>(b / sensor.single().blocks_per_azimuth));
  }
  return data;
}

}  // namespace

TEST_CASE("a data packet's header bytes are little-endian") {
  VelodyneDataPacket data;
  data.blocks[0].azimuth = 12345;
  data.blocks[0].entries[0].distance = 5000;
  const auto bytes = encode(data);
  CHECK(std::vector<int>(bytes.begin(), bytes.begin() + 6) ==
        std::vector<int>{0xFF, 0xEE, 0x39, 0x30, 0x88, 0x13});
}

TEST_CASE("VLP-16 firings have the points of the manual's formulas") {
  const VelodyneSensor sensor = make_velodyne_sensor(VelodyneModel::kVlp16);
  VelodyneDataPacket data = empty_packet(sensor, 12345, 40);
  for (const std::size_t entry : {0U, 3U, 16U, 31U}) data.blocks[0].entries[entry] = {5000, 42};
  const core::Scan scan = decode_one(sensor, data);
  REQUIRE(scan.points.size() == 4);
  require_point(scan.points[0], -5.324271, -8.059368, -2.576961, 0);
  require_point(scan.points[1], -5.508172, -8.329834, 0.521163, 6912);
  require_point(scan.points[2], -5.352371, -8.040734, -2.576961, 55296);
  require_point(scan.points[3], -5.369900, -8.029037, 2.588190 - 0.011230, 89856);
  CHECK(scan.points[0].intensity == 42.0F);
  CHECK(scan.points[0].ring == 0);
  CHECK(scan.points[1].ring == 9);
  CHECK(scan.points[3].ring == 15);
  CHECK(scan.beam_spacing_rad == Approx(2.0 * std::numbers::pi / 180.0));
}

TEST_CASE("VLP-16 firing times are those of the manual") {
  const VelodyneSensor sensor = make_velodyne_sensor(VelodyneModel::kVlp16);
  CHECK(sensor.single().entries[3][17].time_offset_ns == 389376);
  CHECK(sensor.single().entries[11][31].time_offset_ns == 1306368);
  CHECK(sensor.single().packet_period_ns == 1327104);
  CHECK(sensor.single().entries[5][31].azimuth_fraction == Approx((55.296 + 2.304 * 15) / 110.592));
  CHECK(sensor.single().entries[5][31].laser == 15);
}

TEST_CASE("HDL-64E firings have the points of KITTI's geometry") {
  const VelodyneSensor sensor = make_velodyne_sensor(VelodyneModel::kHdl64eS2);
  VelodyneDataPacket data = empty_packet(sensor, 9000, 18);
  data.blocks[0].entries[29] = {10000, 1};
  core::Scan scan = decode_one(sensor, data);
  REQUIRE(scan.points.size() == 1);
  require_point(scan.points[0], 0.71463, -19.97016, 0.88484, 43260);
  CHECK(scan.points[0].ring == 63);

  data = empty_packet(sensor, 27000, 18);
  data.blocks[1].entries[6] = {3000, 1};
  scan = decode_one(sensor, data);
  REQUIRE(scan.points.size() == 1);
  require_point(scan.points[0], 0.13207, 5.48129, -2.44051, 8460);
  CHECK(scan.points[0].ring == 0);
}

TEST_CASE("HDL-64E banks fire together and its azimuth is not interpolated") {
  const VelodyneSensor sensor = make_velodyne_sensor(VelodyneModel::kHdl64eS2);
  CHECK(sensor.single().packet_period_ns == 288000);
  for (std::size_t c = 0; c < kEntriesPerBlock; ++c) {
    CHECK(sensor.single().entries[10][c].laser == c);
    CHECK(sensor.single().entries[11][c].laser == c + 32);
    CHECK(sensor.single().entries[10][c].time_offset_ns == sensor.single().entries[11][c].time_offset_ns);
    CHECK(sensor.single().entries[10][c].azimuth_fraction == 0.0F);
  }
  CHECK(sensor.single().entries[11][31].time_offset_ns == 5 * 48000 + 7 * 6000 + 3660);
}
