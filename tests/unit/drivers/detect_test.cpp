#include "nilio/drivers/velodyne/detect.hpp"

#include "tests/support/disturbed_packets.hpp"
#include "tests/support/drivers_support.hpp"

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::drivers;
using nilio::tests::disturb;
using nilio::tests::Disturbance;
using nilio::tests::disturbances;
using nilio::tests::TurningSensor;

namespace {

std::vector<Packet> packets_of(const TurningSensor& source, std::size_t count) {
  std::vector<Packet> packets;
  for (std::size_t i = 0; i < count; ++i) packets.push_back(source.packet(i));
  return packets;
}

std::vector<Packet> first_of(std::vector<Packet> packets, std::size_t count) {
  packets.resize(std::min(packets.size(), count));
  return packets;
}

/// Packets without a time of their own.
std::vector<Packet> without_clock(std::vector<Packet> packets) {
  for (Packet& packet : packets) std::fill_n(packet.data.begin() + 1200, 4, std::uint8_t{0});
  return packets;
}

}  // namespace

TEST_CASE("every model and return mode is identified from lost, duplicated and reordered packets",
          "[detect]") {
  for (const VelodyneModel model : velodyne_models()) {
    const VelodyneSensor sensor = make_velodyne_sensor(model);
    for (const PacketLayout& layout : sensor.layouts) {
      for (const double revolutions_per_second : {5.0, 10.0, 20.0}) {
        const TurningSensor source{
            .sensor = sensor, .revolutions_per_second = revolutions_per_second, .mode = layout.mode};
        std::vector<Packet> packets = packets_of(source, 200);
        if (!sensor.has_clock) packets = without_clock(std::move(packets));
        for (const Disturbance& how : disturbances()) {
          for (const std::uint32_t seed : {1U, 2U, 3U}) {
            const VelodyneDetection detection = detect_velodyne(first_of(disturb(packets, how, seed), 64));
            INFO(sensor.name << " " << return_mode_name(layout.mode) << " " << revolutions_per_second
                             << " Hz, " << how.name << " seed " << seed << ": " << detection.evidence);
            REQUIRE(detection.agrees_with(model));
            REQUIRE(detection.mode == layout.mode);
            REQUIRE(detection.mode_known);
            // VLP-32A and VLP-32B have the same product byte and period, and different geometry.
            const bool alike = model == VelodyneModel::kVlp32a || model == VelodyneModel::kVlp32b;
            REQUIRE(detection.model.has_value() != alike);
          }
        }
      }
    }
  }
}

TEST_CASE("an early VLP-16 with the product byte of an HDL-32E is a VLP-16, but uncertain", "[detect]") {
  const TurningSensor source{.sensor = make_velodyne_sensor(VelodyneModel::kVlp16)};
  std::vector<Packet> packets = packets_of(source, 300);
  for (Packet& packet : packets) packet.data[1205] = 0x21;
  for (const Disturbance& how : disturbances()) {
    for (std::uint32_t seed = 1; seed <= 20; ++seed) {
      const VelodyneDetection detection = detect_velodyne(first_of(disturb(packets, how, seed), 64));
      INFO(how.name << " seed " << seed << ": " << detection.evidence);
      REQUIRE(detection.model == VelodyneModel::kVlp16);
      REQUIRE_FALSE(detection.agrees_with(VelodyneModel::kHdl32e));
      REQUIRE(detection.agrees_with(VelodyneModel::kPuckHiRes));
      REQUIRE_FALSE(detection.uncertainty.empty());
    }
  }
}

TEST_CASE("every second packet lost makes no VLP-16 of a VLP-32C", "[detect]") {
  const TurningSensor source{.sensor = make_velodyne_sensor(VelodyneModel::kVlp32c)};
  std::vector<Packet> packets;
  for (std::size_t i = 0; i < 128; i += 2) {
    packets.push_back(source.packet(i));
    // A product byte of no model.
    packets.back().data[1205] = 0x00;
  }
  const VelodyneDetection detection = detect_velodyne(packets);
  CHECK(detection.agrees_with(VelodyneModel::kVlp32c));
  CHECK_FALSE(detection.agrees_with(VelodyneModel::kVlp16));
  CHECK_FALSE(detection.uncertainty.empty());
}

TEST_CASE("an HDL-64E without a clock is an S1 only when enough stamps show it", "[detect]") {
  const TurningSensor source{.sensor = make_velodyne_sensor(VelodyneModel::kHdl64eS1)};
  const std::vector<Packet> packets = without_clock(packets_of(source, 20));
  CHECK(detect_velodyne(packets).model == VelodyneModel::kHdl64eS1);
  const VelodyneDetection few = detect_velodyne(first_of(packets, 4));
  CHECK_FALSE(few.model.has_value());
  CHECK(few.agrees_with(VelodyneModel::kHdl64eS1));
}

TEST_CASE("a stopped motor leaves the return mode open", "[detect]") {
  TurningSensor source{.sensor = make_velodyne_sensor(VelodyneModel::kVlp16)};
  source.revolutions_per_second = 0.0;
  std::vector<Packet> packets = packets_of(source, 64);
  const VelodyneDetection detection = detect_velodyne(packets);
  CHECK_FALSE(detection.mode_known);
  CHECK(detection.model == VelodyneModel::kVlp16);
}
