#include "nilio/drivers/velodyne/decoder.hpp"
#include "nilio/drivers/velodyne/packet.hpp"

#include "tests/support/drivers_support.hpp"

#include <numbers>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::drivers;
using nilio::tests::TurningSensor;

namespace {

/// All points of the packet, in one partial scan.
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

TEST_CASE("a data packet's header bytes are little-endian", "[velodyne_geometry]") {
  VelodyneDataPacket data;
  data.blocks[0].azimuth = 12345;
  data.blocks[0].entries[0].distance = 5000;
  const auto bytes = encode(data);
  CHECK(std::vector<int>(bytes.begin(), bytes.begin() + 6) ==
        std::vector<int>{0xFF, 0xEE, 0x39, 0x30, 0x88, 0x13});
}

TEST_CASE("VLP-16 firings give the points of the manual's formulas", "[velodyne_geometry]") {
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

TEST_CASE("VLP-16 firing times are those of the manual", "[velodyne_geometry]") {
  const VelodyneSensor sensor = make_velodyne_sensor(VelodyneModel::kVlp16);
  CHECK(sensor.single().entries[3][17].time_offset_ns == 389376);
  CHECK(sensor.single().entries[11][31].time_offset_ns == 1306368);
  CHECK(sensor.single().packet_period_ns == 1327104);
  CHECK(sensor.single().entries[5][31].azimuth_fraction == Approx((55.296 + 2.304 * 15) / 110.592));
  CHECK(sensor.single().entries[5][31].laser == 15);
}

TEST_CASE("HDL-64E firings give the points of KITTI's geometry", "[velodyne_geometry]") {
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

TEST_CASE("HDL-64E banks fire together and its azimuth is not interpolated", "[velodyne_geometry]") {
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

// Computed from the manuals' formulas in double precision, independently of this code.
TEST_CASE("every model's firings give the points and times of the manuals' formulas", "[velodyne_geometry]") {
  struct KnownAnswer {
    VelodyneModel model;
    ReturnMode mode;
    std::size_t block;
    std::size_t entry;
    std::uint16_t distance;
    int azimuth;
    int azimuth_step;
    std::array<double, 3> point;
    std::int64_t time_ns;
  };
  const std::vector<KnownAnswer> answers{
      {VelodyneModel::kHdl32e,
       ReturnMode::kSingle,
       3,
       7,
       5000,
       12345,
       17,
       {-5.566274, -8.255526, -0.926230},
       146304},
      {VelodyneModel::kPuckHiRes,
       ReturnMode::kSingle,
       2,
       25,
       5000,
       12345,
       40,
       {-5.636610, -8.193657, 1.040880},
       297216},
      {VelodyneModel::kPuckLite,
       ReturnMode::kSingle,
       2,
       25,
       5000,
       12345,
       40,
       {-5.597879, -8.137357, 1.557707},
       297216},
      {VelodyneModel::kVlp16,
       ReturnMode::kDual,
       2,
       3,
       5000,
       12345,
       40,
       {-5.566190, -8.291177, 0.521163},
       117504},
      {VelodyneModel::kVlp32c,
       ReturnMode::kSingle,
       0,
       1,
       2500,
       12345,
       20,
       {-4.885468, -8.723631, -0.173784},
       0},
      {VelodyneModel::kVlp32c,
       ReturnMode::kSingle,
       0,
       31,
       2500,
       12345,
       20,
       {-5.323629, -8.461965, -0.231645},
       34560},
      {VelodyneModel::kVlp32b,
       ReturnMode::kSingle,
       0,
       1,
       2500,
       12345,
       20,
       {-4.885468, -8.723631, -0.173784},
       0},
      {VelodyneModel::kVlp32b,
       ReturnMode::kSingle,
       0,
       31,
       2500,
       12345,
       20,
       {-5.323629, -8.461965, -0.231645},
       34560},
      {VelodyneModel::kVlp32a,
       ReturnMode::kSingle,
       0,
       1,
       2500,
       12345,
       20,
       {-5.335580, -8.456383, 0.144886},
       0},
      {VelodyneModel::kVlp32a,
       ReturnMode::kSingle,
       0,
       31,
       2500,
       12345,
       20,
       {-5.325250, -8.399350, -1.040828},
       34560},
      {VelodyneModel::kVlp32c,
       ReturnMode::kDual,
       4,
       31,
       2500,
       12345,
       20,
       {-5.382574, -8.424593, -0.231645},
       145152},
      {VelodyneModel::kVls128,
       ReturnMode::kSingle,
       1,
       4,
       2500,
       12345,
       20,
       {-4.880123, -7.637001, -4.198843},
       3660},
      {VelodyneModel::kVls128,
       ReturnMode::kSingle,
       2,
       0,
       2500,
       12345,
       20,
       {-6.384197, -7.634330, -0.973534},
       19650},
      {VelodyneModel::kVls128,
       ReturnMode::kSingle,
       11,
       31,
       2500,
       12345,
       20,
       {-4.643035, -8.856444, 0.074608},
       144905},
      {VelodyneModel::kVls128,
       ReturnMode::kDual,
       2,
       4,
       2500,
       12345,
       0,
       {-4.874790, -7.640406, -4.198843},
       3660},
      {VelodyneModel::kVls128,
       ReturnMode::kDualConfidence,
       3,
       4,
       2500,
       12345,
       0,
       {-4.874790, -7.640406, -4.198843},
       3660},
      {VelodyneModel::kHdl64eS2,
       ReturnMode::kSingle,
       0,
       29,
       10000,
       9000,
       18,
       {0.714631, -19.970156, 0.884835},
       43260},
      {VelodyneModel::kHdl64eS2,
       ReturnMode::kSingle,
       1,
       6,
       3000,
       27000,
       18,
       {0.132074, 5.481291, -2.440513},
       8460},
      {VelodyneModel::kHdl64eS21,
       ReturnMode::kSingle,
       0,
       29,
       10000,
       9000,
       18,
       {0.908779, -21.261727, 2.065245},
       43260},
      {VelodyneModel::kHdl64eS21,
       ReturnMode::kSingle,
       1,
       6,
       3000,
       21000,
       18,
       {-5.805047, 3.604933, -3.047953},
       8460},
      {VelodyneModel::kHdl64eS1,
       ReturnMode::kSingle,
       1,
       6,
       3000,
       21000,
       18,
       {-5.805047, 3.604933, -3.047953},
       8460},
      {VelodyneModel::kHdl64eS21,
       ReturnMode::kSingle,
       2,
       6,
       30000,
       21000,
       18,
       {-51.154089, 31.925525, -11.372698},
       56460},
      {VelodyneModel::kHdl64eS3,
       ReturnMode::kSingle,
       3,
       6,
       3000,
       21000,
       18,
       {-5.855329, 3.620056, -2.970621},
       56460},
      {VelodyneModel::kHdl64eS3,
       ReturnMode::kDual,
       5,
       6,
       3000,
       21000,
       18,
       {-5.855329, 3.620056, -2.970621},
       67300},
      {VelodyneModel::kHdl64eS3,
       ReturnMode::kDual,
       6,
       6,
       3000,
       21000,
       18,
       {-6.299964, 3.786583, -0.888454},
       67300},
  };
  for (const KnownAnswer& answer : answers) {
    const VelodyneSensor sensor = make_velodyne_sensor(answer.model);
    INFO(sensor.name << " " << return_mode_name(answer.mode) << " block " << answer.block << " entry "
                     << answer.entry);
    const PacketLayout* layout = sensor.layout(answer.mode);
    REQUIRE(layout != nullptr);
    VelodyneDataPacket data;
    for (std::size_t b = 0; b < kBlocksPerPacket; ++b) {
      data.blocks[b].flag = layout->block_flags[b];
      data.blocks[b].azimuth = static_cast<std::uint16_t>(
          answer.azimuth + answer.azimuth_step * static_cast<int>(b / layout->blocks_per_azimuth));
    }
    data.blocks[answer.block].entries[answer.entry] = {answer.distance, 50};
    data.timestamp_us = static_cast<std::uint32_t>(nilio::tests::kEpochNs / 1000 % 3'600'000'000);
    data.factory_byte_1 = layout->return_mode_byte;
    data.factory_byte_2 = sensor.product_byte;
    Packet packet = TurningSensor::wrap(data);
    packet.stamp.ns = nilio::tests::kEpochNs + layout->packet_period_ns;
    ScanAssembler assembler(
        sensor, {.time_source = TimeSource::kSensor, .return_mode = answer.mode, .min_coverage = 0.0});
    REQUIRE_FALSE(assembler.add(packet));
    REQUIRE(assembler.finish());
    core::Scan scan;
    assembler.take_scan(scan);
    REQUIRE(scan.points.size() == 1);
    const core::Point& point = scan.points.front();
    CHECK(point.x == Approx(answer.point[0]).margin(3e-5));
    CHECK(point.y == Approx(answer.point[1]).margin(3e-5));
    CHECK(point.z == Approx(answer.point[2]).margin(3e-5));
    const std::int64_t time_ns = scan.start.ns + point.time_offset_ns - nilio::tests::kEpochNs;
    CHECK(time_ns == answer.time_ns);
  }
}

TEST_CASE("the HDL-64E's intensity is corrected for focus and kept within its laser's limits",
          "[velodyne_geometry]") {
  const VelodyneSensor sensor = make_velodyne_sensor(VelodyneModel::kHdl64eS21);
  VelodyneDataPacket data = empty_packet(sensor, 9000, 18);
  data.blocks[0].entries[0] = {10000, 40};
  data.blocks[0].entries[1] = {10000, 0};
  const core::Scan scan = decode_one(sensor, data);
  REQUIRE(scan.points.size() == 2);
  // Laser 0: focus 12 m, slope 1.4, 30..235; raw + slope * |256 (1 - 12/131)^2 - 256 (1 - 10000/65535)^2|.
  CHECK(scan.points[0].intensity == Approx(78.378).margin(0.05));
  // Laser 1: focus 5 m, slope 1, never below 40.
  CHECK(scan.points[1].intensity == Approx(52.996).margin(0.05));
}
