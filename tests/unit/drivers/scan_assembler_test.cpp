#include "nilio/drivers/velodyne/detect.hpp"

#include "tests/support/drivers_support.hpp"

#include <map>
#include <random>
#include <set>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::drivers;
using nilio::tests::assemble;
using nilio::tests::kEpochNs;
using nilio::tests::TurningSensor;

namespace {

TurningSensor vlp16() { return {.sensor = make_velodyne_sensor(VelodyneModel::kVlp16)}; }

std::vector<Packet> packets_of(const TurningSensor& source, std::size_t first, std::size_t last) {
  std::vector<Packet> packets;
  for (std::size_t i = first; i < last; ++i) packets.push_back(source.packet(i));
  return packets;
}

/// Absolute time of every point, by range and ring: the range identifies the block, ring and time within it
/// the entry.
std::multimap<std::int64_t, int> firing_times(const std::vector<core::Scan>& scans) {
  std::multimap<std::int64_t, int> times;
  for (const core::Scan& scan : scans) {
    for (const core::Point& p : scan.points) times.emplace(scan.start.ns + p.time_offset_ns, p.ring);
  }
  return times;
}

}  // namespace

TEST_CASE("encoding and decoding a data packet are exact inverses", "[scan_assembler]") {
  const VelodyneDataPacket data = vlp16().data(5);
  const auto bytes = encode(data);
  const auto decoded = decode(bytes);
  REQUIRE(decoded.has_value());
  CHECK(encode(*decoded) == bytes);
  CHECK(decoded->timestamp_us == data.timestamp_us);
  CHECK(decoded->blocks[11].entries[31].distance == data.blocks[11].entries[31].distance);
  CHECK_FALSE(decode(std::span(bytes).first(1205)).has_value());
}

TEST_CASE("a scan is complete with its last packet, also when the cut is between two packets",
          "[scan_assembler]") {
  for (const VelodyneModel model : {VelodyneModel::kVlp16, VelodyneModel::kHdl64eS2}) {
    // The cut moves through the packets, because a revolution is not a whole number of them.
    const TurningSensor source{.sensor = make_velodyne_sensor(model), .revolutions_per_second = 10.03};
    const auto packets = static_cast<std::size_t>(4'000'000'000 / source.sensor.single().packet_period_ns);
    ScanAssembler assembler(source.sensor, {});
    std::size_t scans = 0;
    std::size_t late = 0;
    std::uint64_t firings = 0;
    core::Scan scan;
    for (std::size_t i = 0; i < packets; ++i) {
      const Packet packet = source.packet(i);
      if (!assembler.add(packet)) continue;
      assembler.take_scan(scan);
      ++scans;
      late += scan.received_ns == packet.received_ns ? 0 : 1;
      firings += scan.points.size();
      CHECK(scan.coverage_deg > 359.0F);
    }
    CHECK(scans >= 39);
    CHECK(late == 0);
    CHECK(assembler.stats().partial_scans == 1);
    CHECK(firings == assembler.stats().firings_in_scans);
  }
}

TEST_CASE("a cut in the middle of a packet puts every firing into exactly one scan", "[scan_assembler]") {
  for (const VelodyneModel model : {VelodyneModel::kVlp16, VelodyneModel::kHdl64eS2}) {
    // Begins at the cut, so that no part of a revolution is dropped.
    const TurningSensor source{.sensor = make_velodyne_sensor(model), .start_azimuth_deg = 180.0};
    const auto packets = static_cast<std::size_t>(400'000'000 / source.sensor.single().packet_period_ns);
    ScanAssembler assembler(source.sensor, {});
    std::vector<core::Scan> scans = assemble(assembler, packets_of(source, 0, packets));
    if (assembler.finish()) {
      scans.emplace_back();
      assembler.take_scan(scans.back());
    }
    REQUIRE(scans.size() >= 3);
    std::size_t points = 0;
    bool cut_inside_a_packet = false;
    for (std::size_t i = 0; i < scans.size(); ++i) {
      points += scans[i].points.size();
      CHECK(scans[i].sequence == i);
      CHECK(scans[i].coverage_deg >= 355.0F);
      if (i == 0) continue;
      CHECK(scans[i].start > scans[i - 1].end);
      cut_inside_a_packet =
          cut_inside_a_packet ||
          (scans[i].start.ns - source.start_ns) % source.sensor.single().packet_period_ns != 0;
    }
    CHECK(cut_inside_a_packet);
    CHECK(assembler.stats().partial_scans <= 1);
    const auto times = firing_times(scans);
    CHECK(times.size() == points);
    // Each instant has as many points as lasers that fire together, without duplicates.
    const std::size_t at_once = source.sensor.single().blocks_per_azimuth;
    CHECK(times.count(times.begin()->first) == at_once);
    std::set<std::pair<std::int64_t, int>> distinct(times.begin(), times.end());
    CHECK(distinct.size() == points);
    if (assembler.stats().partial_scans == 0) CHECK(points == packets * kBlocksPerPacket * kEntriesPerBlock);
  }
}

TEST_CASE("scans begin at the cut azimuth, whatever its value", "[scan_assembler]") {
  for (const double cut : {0.0, 90.0, 359.9, -10.0}) {
    const TurningSensor source = vlp16();
    ScanAssembler assembler(source.sensor, {.cut_azimuth_deg = cut});
    const auto scans = assemble(assembler, packets_of(source, 0, 300));
    REQUIRE(scans.size() >= 2);
    const double turns = static_cast<double>(scans[1].start.ns - source.start_ns) * 1e-9 * 10.0;
    const double azimuth = std::fmod(turns * 360.0 - cut + 720.0, 360.0);
    CHECK(azimuth < 0.41);
    CHECK((scans[1].end - scans[1].start).seconds() == Approx(0.1).margin(2e-4));
  }
}

TEST_CASE("scan times are the sensor's when its clock agrees with the host's", "[scan_assembler]") {
  TurningSensor source = vlp16();
  source.sensor_ahead_ns = 50'000'000;
  ScanAssembler assembler(source.sensor, {});
  const auto scans = assemble(assembler, packets_of(source, 0, 250));
  REQUIRE_FALSE(scans.empty());
  const std::int64_t since_start = scans[0].start.ns - source.start_ns - source.sensor_ahead_ns;
  CHECK(since_start % 1000 == scans[0].start.ns % 1000);
  CHECK(since_start >= 0);
  CHECK(scans[0].end.ns - scans[0].start.ns < 101'000'000);
  CHECK(scans[0].received_ns > 0);
}

TEST_CASE("a free-running sensor clock is shifted by the minimum delay of the first packets",
          "[scan_assembler]") {
  TurningSensor source = vlp16();
  source.start_azimuth_deg = 180.0;
  source.sensor_ahead_ns = 1'234'567'000'000;
  ScanAssembler assembler(source.sensor, {});
  std::vector<Packet> packets;
  for (std::size_t i = 0; i < 250; ++i) packets.push_back(source.packet(i, i % 7 == 3 ? 0 : 400'000));
  const auto scans = assemble(assembler, packets);
  REQUIRE(scans.size() >= 2);
  CHECK(std::abs(scans[0].start.ns - source.start_ns) < 2'000);
}

TEST_CASE("host time is the receive time minus the packet's duration", "[scan_assembler]") {
  TurningSensor source = vlp16();
  source.start_azimuth_deg = 180.0;
  source.sensor_ahead_ns = 77'000'000'000;
  ScanAssembler assembler(source.sensor, {.time_source = TimeSource::kHost});
  const auto scans = assemble(assembler, packets_of(source, 0, 100));
  REQUIRE(scans.size() == 1);
  CHECK(scans[0].start.ns == source.start_ns);
}

TEST_CASE("the hour counter rolls over without a jump in time", "[scan_assembler]") {
  TurningSensor source = vlp16();
  source.start_azimuth_deg = 180.0;
  const std::int64_t hour = 3'600'000'000'000;
  source.start_ns = kEpochNs / hour * hour + hour - 150'000'000;
  ScanAssembler assembler(source.sensor, {});
  const auto scans = assemble(assembler, packets_of(source, 0, 310));
  REQUIRE(scans.size() == 4);
  for (std::size_t i = 1; i < scans.size(); ++i) {
    CHECK((scans[i].start - scans[i - 1].start).seconds() == Approx(0.1).margin(3e-4));
  }
  CHECK(std::abs(scans[0].start.ns - source.start_ns) < 2'000);
  CHECK(assembler.stats().time_jumps == 0);
  CHECK(assembler.stats().lost_packets == 0);
}

TEST_CASE("the hour is resolved when sensor and host are on different sides of it", "[scan_assembler]") {
  TurningSensor source = vlp16();
  source.start_azimuth_deg = 180.0;
  const std::int64_t hour = 3'600'000'000'000;
  source.start_ns = kEpochNs / hour * hour + hour - 20'000'000;
  source.sensor_ahead_ns = 30'000'000;
  ScanAssembler assembler(source.sensor, {});
  const auto scans = assemble(assembler, packets_of(source, 0, 100));
  REQUIRE(scans.size() == 1);
  CHECK(std::abs(scans[0].start.ns - source.start_ns - source.sensor_ahead_ns) < 2'000);
}

TEST_CASE("a packet lost inside a scan leaves the other firings' points and times unchanged",
          "[scan_assembler]") {
  const TurningSensor source = vlp16();
  std::vector<Packet> packets = packets_of(source, 0, 250);
  ScanAssembler whole(source.sensor, {});
  const auto expected = assemble(whole, packets);
  packets.erase(packets.begin() + 80, packets.begin() + 83);
  ScanAssembler assembler(source.sensor, {});
  const auto scans = assemble(assembler, packets);
  REQUIRE(scans.size() == expected.size());
  CHECK(assembler.stats().lost_packets == 3);
  CHECK(assembler.stats().time_jumps == 0);
  std::uint32_t lost = 0;
  for (std::size_t i = 0; i < scans.size(); ++i) {
    lost += scans[i].lost_packets;
    CHECK(scans[i].start == expected[i].start);
    std::set<std::tuple<std::int32_t, int, float, float>> points;
    for (const core::Point& p : expected[i].points) points.emplace(p.time_offset_ns, p.ring, p.x, p.y);
    for (const core::Point& p : scans[i].points)
      REQUIRE(points.count({p.time_offset_ns, p.ring, p.x, p.y}) == 1);
  }
  CHECK(lost == 3);
}

TEST_CASE("a loss across the cut does not move the cut", "[scan_assembler]") {
  const TurningSensor source = vlp16();
  std::vector<Packet> packets = packets_of(source, 0, 320);
  // The cut at 180 degrees is near packet 113 (150 ms).
  packets.erase(packets.begin() + 108, packets.begin() + 120);
  ScanAssembler assembler(source.sensor, {});
  const auto scans = assemble(assembler, packets);
  REQUIRE(scans.size() >= 2);
  CHECK((scans[0].end - scans[0].start).seconds() < 0.1);
  CHECK((scans[1].end - scans[1].start).seconds() < 0.1);
  CHECK(scans[0].lost_packets == 12);
}

TEST_CASE("a loss of more than a revolution drops the rest of both scans", "[scan_assembler]") {
  const TurningSensor source = vlp16();
  std::vector<Packet> packets = packets_of(source, 0, 450);
  packets.erase(packets.begin() + 70, packets.begin() + 230);
  ScanAssembler assembler(source.sensor, {});
  const auto scans = assemble(assembler, packets);
  CHECK(assembler.stats().lost_packets == 160);
  CHECK(assembler.stats().partial_scans >= 2);
  REQUIRE_FALSE(scans.empty());
  for (const core::Scan& scan : scans) CHECK((scan.end - scan.start).seconds() == Approx(0.1).margin(3e-4));
}

TEST_CASE("duplicate and reordered packets are counted and change nothing", "[scan_assembler]") {
  const TurningSensor source = vlp16();
  const std::vector<Packet> packets = packets_of(source, 0, 250);
  ScanAssembler plain(source.sensor, {});
  const auto expected = assemble(plain, packets);
  std::vector<Packet> disturbed;
  for (std::size_t i = 0; i < packets.size(); ++i) {
    disturbed.push_back(packets[i]);
    if (i == 50) disturbed.push_back(packets[i]);
    if (i == 90) disturbed.push_back(packets[i - 4]);
  }
  // One packet overtaken by three others.
  std::rotate(disturbed.begin() + 150, disturbed.begin() + 151, disturbed.begin() + 154);
  ScanAssembler assembler(source.sensor, {});
  const auto scans = assemble(assembler, disturbed);
  CHECK(assembler.stats().duplicate_packets == 2);
  CHECK(assembler.stats().lost_packets == 0);
  CHECK(assembler.stats().late_packets == 1);
  CHECK(assembler.stats().time_jumps == 0);
  REQUIRE(scans.size() == expected.size());
  for (std::size_t i = 0; i < scans.size(); ++i) {
    CHECK(scans[i].points.size() == expected[i].points.size());
    CHECK(scans[i].start == expected[i].start);
  }
}

TEST_CASE("a restarted sensor is used from its new time on", "[scan_assembler]") {
  TurningSensor source = vlp16();
  source.sensor_ahead_ns = 10'000'000'000;
  std::vector<Packet> packets = packets_of(source, 0, 200);
  TurningSensor restarted = source;
  restarted.sensor_ahead_ns = -600'000'000'000;
  restarted.start_ns = source.packet_time_ns(200) + 300'000'000;
  for (const Packet& packet : packets_of(restarted, 0, 200)) packets.push_back(packet);
  ScanAssembler assembler(source.sensor, {});
  const auto scans = assemble(assembler, packets);
  CHECK(assembler.stats().time_jumps == 1);
  CHECK(assembler.stats().lost_packets == 0);
  REQUIRE(scans.size() >= 3);
  for (const core::Scan& scan : scans) {
    CHECK(scan.start.ns >= source.start_ns - 2'000);
    CHECK((scan.end - scan.start).seconds() == Approx(0.1).margin(3e-4));
  }
  CHECK(scans.back().start.ns > restarted.start_ns);
}

TEST_CASE("a stalled motor ends scans by time and they are dropped as partial", "[scan_assembler]") {
  TurningSensor source = vlp16();
  source.revolutions_per_second = 0.0;
  source.start_azimuth_deg = 20.0;
  ScanAssembler assembler(source.sensor, {});
  const auto scans = assemble(assembler, packets_of(source, 0, 1000));
  CHECK(scans.empty());
  CHECK(assembler.stats().partial_scans == 4);
}

TEST_CASE("wrong blocks are skipped and counted, the others are kept", "[scan_assembler]") {
  const TurningSensor source = vlp16();
  std::vector<Packet> packets = packets_of(source, 0, 250);
  VelodyneDataPacket data = source.data(100);
  data.blocks[3].flag = 0xDDFF;
  data.blocks[5].azimuth = 36000;
  data.blocks[8].azimuth = static_cast<std::uint16_t>((data.blocks[8].azimuth + 9000) % 36000);
  const Packet original = packets[100];
  packets[100] = TurningSensor::wrap(data);
  packets[100].stamp = original.stamp;
  ScanAssembler assembler(source.sensor, {});
  ScanAssembler whole(source.sensor, {});
  const auto scans = assemble(assembler, packets);
  CHECK(assembler.stats().firings_bad == 3 * kEntriesPerBlock);
  CHECK(scans.size() == assemble(whole, packets_of(source, 0, 250)).size());
  CHECK(whole.stats().points - assembler.stats().points == 3 * kEntriesPerBlock);
}

TEST_CASE("a blind sector inside a packet delays the firings after it", "[scan_assembler]") {
  const TurningSensor source = vlp16();
  VelodyneDataPacket data = source.data(10);
  for (std::size_t b = 6; b < kBlocksPerPacket; ++b) {
    data.blocks[b].azimuth = static_cast<std::uint16_t>(data.blocks[b].azimuth + 17'990);
  }
  Packet packet = TurningSensor::wrap(data);
  packet.stamp.ns = source.packet_time_ns(10) + 50'000'000;
  ScanAssembler assembler(source.sensor, {.cut_azimuth_deg = 350.0, .min_coverage = 0.0});
  CHECK_FALSE(assembler.add(packet));
  REQUIRE(assembler.finish());
  core::Scan scan;
  assembler.take_scan(scan);
  CHECK(assembler.stats().firings_bad == 0);
  // 179.9 degrees at 10 revolutions per second; the rate is accurate to one part in forty.
  CHECK((scan.end - scan.start).seconds() == Approx(0.05).margin(0.0015));
}

TEST_CASE("packets of other lengths are counted and position packets give no points", "[scan_assembler]") {
  const TurningSensor source = vlp16();
  ScanAssembler assembler(source.sensor, {});
  Packet packet = source.packet(0);
  packet.size = 1205;
  CHECK_FALSE(assembler.add(packet));
  packet.size = 0;
  CHECK_FALSE(assembler.add(packet));
  packet.size = kPositionPacketSize;
  CHECK_FALSE(assembler.add(packet));
  packet.size = kPacketCapacity;
  packet.truncated = true;
  CHECK_FALSE(assembler.add(packet));
  CHECK(assembler.stats().bad_length == 3);
  CHECK(assembler.stats().packets == 0);
}

TEST_CASE("range limits are inclusive and returns beyond them are counted", "[scan_assembler]") {
  const VelodyneSensor sensor = make_velodyne_sensor(VelodyneModel::kVlp16);
  const TurningSensor source{.sensor = sensor};
  VelodyneDataPacket data = source.data(0);
  for (auto& block : data.blocks) block.entries.fill({});
  data.blocks[0].entries[0].distance = 500;
  data.blocks[0].entries[1].distance = 499;
  data.blocks[0].entries[2].distance = 10000;
  data.blocks[0].entries[3].distance = 10001;
  ScanAssembler assembler(sensor, {.min_range_m = 1.0, .max_range_m = 20.0, .min_coverage = 0.0});
  assembler.add(TurningSensor::wrap(data));
  CHECK(assembler.stats().points == 2);
  CHECK(assembler.stats().points_out_of_range == 2);
}

TEST_CASE("no packets, however malformed, make a scan larger than its capacity", "[scan_assembler]") {
  const TurningSensor source = vlp16();
  ScanAssembler assembler(source.sensor, {.min_coverage = 0.0});
  core::Scan scan;
  std::size_t largest = 0;
  for (std::uint32_t i = 0; i < 2000; ++i) {
    // Time and azimuth hardly advance: neither would end the scan.
    VelodyneDataPacket data = source.data(0);
    for (auto& block : data.blocks) block.azimuth = 100;
    data.timestamp_us = i + 1;
    Packet packet = TurningSensor::wrap(data);
    packet.stamp.ns = kEpochNs;
    if (!assembler.add(packet)) continue;
    assembler.take_scan(scan);
    largest = std::max(largest, scan.points.size());
  }
  CHECK(largest > 0);
  CHECK(largest <= 460 * kBlocksPerPacket * kEntriesPerBlock);
}

TEST_CASE("assembling reuses the buffers it is given", "[scan_assembler]") {
  const TurningSensor source = vlp16();
  ScanAssembler assembler(source.sensor, {});
  core::Scan scan;
  std::set<const core::Point*> buffers;
  for (std::size_t i = 0; i < 1500; ++i) {
    if (!assembler.add(source.packet(i))) continue;
    assembler.take_scan(scan);
    buffers.insert(scan.points.data());
  }
  CHECK(assembler.stats().scans > 15);
  CHECK(buffers.size() <= 3);
}

TEST_CASE("evenly lost packets leave a scan for every revolution and are counted", "[scan_assembler]") {
  for (const VelodyneModel model : {VelodyneModel::kVlp16, VelodyneModel::kHdl64eS2}) {
    for (const double revolutions_per_second : {5.0, 10.0, 20.0}) {
      for (const double share : {0.2, 0.5}) {
        const TurningSensor source{.sensor = make_velodyne_sensor(model),
                                   .revolutions_per_second = revolutions_per_second,
                                   .start_azimuth_deg = 180.0};
        const auto count = static_cast<std::size_t>(40.5 / revolutions_per_second * 1e9 /
                                                    static_cast<double>(source.layout().packet_period_ns));
        std::mt19937 random(17);
        std::uniform_real_distribution<double> uniform(0.0, 1.0);
        std::vector<Packet> packets;
        for (std::size_t i = 0; i < count; ++i) {
          if (i < 5 || i + 1 == count || uniform(random) >= share) packets.push_back(source.packet(i));
        }
        ScanAssembler assembler(source.sensor, {});
        const auto scans = assemble(assembler, packets);
        INFO(source.sensor.name << ", " << revolutions_per_second << " Hz, " << share << " lost");
        CHECK(scans.size() == 40);
        CHECK(assembler.stats().partial_scans == 0);
        CHECK(assembler.stats().firings_discarded == 0);
        CHECK(assembler.stats().lost_packets == count - packets.size());
        CHECK(assembler.status().revolutions_per_minute ==
              Approx(60.0 * revolutions_per_second).epsilon(1e-3));
      }
    }
  }
}

TEST_CASE("the speed in the status is a mean over time", "[scan_assembler]") {
  TurningSensor source = vlp16();
  ScanAssembler assembler(source.sensor, {});
  for (std::size_t i = 0; i < 2000; ++i) {
    // An encoder that is read in steps of half a degree: a packet shows 12 % more or less.
    VelodyneDataPacket data = source.data(i);
    for (auto& block : data.blocks) block.azimuth = static_cast<std::uint16_t>(block.azimuth / 50 * 50);
    Packet packet = TurningSensor::wrap(data);
    packet.stamp = source.packet(i).stamp;
    assembler.add(packet);
    if (i > 200) REQUIRE(assembler.status().revolutions_per_minute == Approx(600.0).margin(1.0));
  }
}

TEST_CASE("every model is detected from its own packets only", "[scan_assembler]") {
  const TurningSensor puck = vlp16();
  const TurningSensor hdl{.sensor = make_velodyne_sensor(VelodyneModel::kHdl64eS2)};
  CHECK(detect_velodyne(packets_of(puck, 0, 5)).model == VelodyneModel::kVlp16);
  CHECK(detect_velodyne(packets_of(hdl, 0, 9)).model == VelodyneModel::kHdl64eS2);
  VelodyneDataPacket other = puck.data(0);
  other.factory_byte_2 = 0x21;
  CHECK(detect_velodyne(std::vector<Packet>{TurningSensor::wrap(other)}).model == VelodyneModel::kHdl32e);
  CHECK_FALSE(detect_velodyne({}).model.has_value());
}

TEST_CASE("a change of the return mode at the sensor is followed", "[scan_assembler]") {
  TurningSensor single = vlp16();
  TurningSensor dual = single;
  dual.mode = ReturnMode::kDual;
  dual.start_ns = single.packet_time_ns(200);
  std::vector<Packet> packets = packets_of(single, 0, 200);
  for (const Packet& packet : packets_of(dual, 0, 400)) packets.push_back(packet);
  ScanAssembler assembler(single.sensor, {});
  const auto scans = assemble(assembler, packets);
  CHECK(assembler.stats().mode_changes == 1);
  CHECK(assembler.status().mode == ReturnMode::kDual);
  REQUIRE(scans.size() >= 4);
  CHECK((scans.back().end - scans.back().start).seconds() == Approx(0.1).margin(3e-4));
  CHECK(scans.back().points.size() == Approx(28'900).margin(200));
}

TEST_CASE("of two returns the selected ones become points, and two equal ones become one point",
          "[scan_assembler]") {
  const VelodyneSensor sensor = make_velodyne_sensor(VelodyneModel::kVlp16);
  TurningSensor source{.sensor = sensor};
  source.mode = ReturnMode::kDual;
  VelodyneDataPacket data = source.data(0);
  for (auto& block : data.blocks) block.entries.fill({});
  // Last and strongest differ; are equal; only a last; only a strongest; the last is the strongest.
  data.blocks[0].entries[0] = {6000, 10};
  data.blocks[1].entries[0] = {5000, 90};
  data.blocks[0].entries[1] = data.blocks[1].entries[1] = {5000, 50};
  data.blocks[0].entries[2] = {5000, 50};
  data.blocks[1].entries[3] = {5000, 50};
  data.blocks[0].entries[4] = {6000, 90};
  data.blocks[1].entries[4] = {5000, 10};
  const auto ranges = [&](ReturnChoice returns) {
    ScanAssembler assembler(sensor, {.returns = returns, .min_coverage = 0.0});
    assembler.add(TurningSensor::wrap(data));
    REQUIRE(assembler.finish());
    core::Scan scan;
    assembler.take_scan(scan);
    std::multiset<std::pair<int, int>> result;
    for (const core::Point& p : scan.points)
      result.emplace(p.ring, static_cast<int>(std::lround(std::hypot(p.x, p.y, p.z))));
    return result;
  };
  // Entries 0 to 4 are rings 0, 8, 1, 9, 2.
  using Ranges = std::multiset<std::pair<int, int>>;
  CHECK(ranges(ReturnChoice::kAll) == Ranges{{0, 12}, {0, 10}, {8, 10}, {1, 10}, {9, 10}, {2, 12}, {2, 10}});
  CHECK(ranges(ReturnChoice::kLast) == Ranges{{0, 12}, {8, 10}, {1, 10}, {9, 10}, {2, 12}});
  CHECK(ranges(ReturnChoice::kStrongest) == Ranges{{0, 10}, {8, 10}, {1, 10}, {9, 10}, {2, 12}});
}

TEST_CASE("a sector in which the sensor does not fire is no loss and leaves scans complete",
          "[scan_assembler]") {
  // Packets end at the end of the field of view: the gap is between packets.
  TurningSensor source{.sensor = make_velodyne_sensor(VelodyneModel::kVlp32c)};
  source.start_azimuth_deg = 180.0;
  std::vector<Packet> packets;
  std::size_t skipped = 0;
  for (std::size_t i = 0; i < 3000; ++i) {
    const int azimuth = source.azimuth(i, 0);
    // A sector of 120 degrees, in whole packets.
    const bool blind = azimuth > 12'000 && azimuth <= 24'000;
    skipped += static_cast<std::size_t>(blind);
    if (!blind) packets.push_back(source.packet(i));
  }
  REQUIRE(skipped > 900);
  ScanAssembler assembler(source.sensor, {.max_range_m = 1000.0});
  const auto scans = assemble(assembler, packets);
  CHECK(assembler.stats().lost_packets == 0);
  CHECK(assembler.status().blind_sector_deg == Approx(120.0).margin(5.0));
  REQUIRE(scans.size() >= 15);
  CHECK(scans.back().coverage_deg == Approx(240.0).margin(5.0));
  CHECK(scans.back().lost_packets == 0);
  CHECK(scans.back().missing_firings == 0);
}

TEST_CASE("a change of speed neither loses firings nor moves the cut", "[scan_assembler]") {
  TurningSensor source = vlp16();
  ScanAssembler assembler(source.sensor, {.max_range_m = 1000.0, .min_coverage = 0.0});
  double turns = 0.5;
  std::vector<core::Scan> scans;
  constexpr std::size_t kPackets = 4000;
  for (std::size_t i = 0; i < kPackets; ++i) {
    VelodyneDataPacket data = source.data(i);
    for (std::size_t b = 0; b < kBlocksPerPacket; ++b) {
      data.blocks[b].azimuth = static_cast<std::uint16_t>(std::llround(turns * 36'000.0) % 36'000);
      // From 5 to 20 revolutions a second.
      const double speed = 5.0 + 15.0 * static_cast<double>(i) / kPackets;
      turns += speed * static_cast<double>(source.layout().azimuth_period_ns) * 1e-9;
    }
    Packet packet = TurningSensor::wrap(data);
    packet.stamp = source.packet(i).stamp;
    if (assembler.add(packet)) assembler.take_scan(scans.emplace_back());
  }
  if (assembler.finish()) assembler.take_scan(scans.emplace_back());
  CHECK(scans.size() == static_cast<std::size_t>(turns - 0.5) + 1);
  CHECK(assembler.stats().firings_in_scans == kPackets * 384);
  CHECK(assembler.stats().firings_bad == 0);
  for (std::size_t i = 1; i + 1 < scans.size(); ++i)
    CHECK(scans[i].coverage_deg == Approx(360.0).margin(1.0));
}
