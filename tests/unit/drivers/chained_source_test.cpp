#include "nilio/drivers/can/can_files.hpp"
#include "nilio/drivers/capture/pcap.hpp"

#include "tests/support/drivers_support.hpp"

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::drivers;
using Catch::Matchers::Contains;
using nilio::tests::kEpochNs;
using nilio::tests::TemporaryFile;

namespace {

/// A capture of packets numbered in their first byte.
std::string capture_of(std::uint8_t first, std::uint8_t count) {
  std::vector<std::uint8_t> bytes;
  append_pcap_header(bytes);
  for (std::uint8_t i = 0; i < count; ++i) {
    const std::vector<std::uint8_t> payload(1206, static_cast<std::uint8_t>(first + i));
    REQUIRE(append_pcap_record(bytes, {kEpochNs + (first + i) * 1000}, {.destination_port = 2368}, payload));
  }
  return {bytes.begin(), bytes.end()};
}

struct Contents {
  std::vector<int> numbers;
  SourceState state = SourceState::kData;
};

Contents read_all(PacketSource& source) {
  Contents contents;
  std::array<Packet, 3> slots;
  for (;;) {
    const SourceRead result = source.read(slots, core::Duration{});
    contents.state = result.state;
    if (result.state != SourceState::kData) return contents;
    for (const Packet& packet : std::span(slots).first(result.count))
      contents.numbers.push_back(packet.data[0]);
  }
}

std::vector<int> counting(int first, int last) {
  std::vector<int> numbers;
  for (int i = first; i <= last; ++i) numbers.push_back(i);
  return numbers;
}

}  // namespace

TEST_CASE("captures in a chain are read as one, in order and with one count", "[chained_source]") {
  const TemporaryFile a(capture_of(0, 5), ".pcap");
  const TemporaryFile b(capture_of(5, 1), ".pcap");
  const TemporaryFile c(capture_of(6, 7), ".pcap");
  auto source = chain_captures({a.path(), b.path(), c.path()}, {});
  REQUIRE(source.ok());
  const Contents contents = read_all(**source);
  CHECK(contents.numbers == counting(0, 12));
  CHECK(contents.state == SourceState::kEnd);
  CHECK((*source)->stats().delivered == 13);
  CHECK((*source)->stats().malformed == 0);
  CHECK_THAT((*source)->status(), Contains("13 from 3 files"));
}

TEST_CASE("a failing file of a chain is named and counted, and the others are read", "[chained_source]") {
  const TemporaryFile a(capture_of(0, 3), ".pcap");
  const TemporaryFile empty("", ".pcap");
  const std::string cut = capture_of(3, 4);
  const TemporaryFile b(cut.substr(0, cut.size() - 100), ".pcap");
  const TemporaryFile c(capture_of(7, 2), ".pcap");
  auto source = chain_captures({empty.path(), a.path(), "/nonexistent/x.pcap", b.path(), c.path()}, {});
  REQUIRE(source.ok());
  const Contents contents = read_all(**source);
  CHECK(contents.numbers == std::vector<int>{0, 1, 2, 3, 4, 5, 7, 8});
  CHECK(contents.state == SourceState::kEnd);
  CHECK((*source)->stats().malformed == 3);
  CHECK_THAT((*source)->status(), Contains(empty.path()) && Contains("/nonexistent/x.pcap") &&
                                      Contains(b.path()) && Contains("middle of a packet"));
}

TEST_CASE("a chain without a readable file is an error that names the first", "[chained_source]") {
  const TemporaryFile empty("", ".pcap");
  const auto source = chain_captures({empty.path(), "/nonexistent/x.pcap"}, {});
  REQUIRE_FALSE(source.ok());
  CHECK_THAT(source.error().message, Contains(empty.path()) && Contains("/nonexistent/x.pcap"));
  CHECK_FALSE(chain_captures({}, {}).ok());
  const auto one = chain_captures({"/nonexistent/x.pcap"}, {});
  REQUIRE_FALSE(one.ok());
  CHECK(one.error().message == open_pcap("/nonexistent/x.pcap", {}).error().message);
}

TEST_CASE("a chain of one file has the status of the file", "[chained_source]") {
  const TemporaryFile file(capture_of(0, 5), ".pcap");
  auto chained = chain_captures({file.path()}, {});
  auto alone = open_pcap(file.path(), {});
  REQUIRE(chained.ok());
  REQUIRE(alone.ok());
  read_all(**chained);
  read_all(**alone);
  CHECK((*chained)->status() == (*alone)->status());
}

TEST_CASE("CAN logs in a chain are read as one, a line cut at the end of one being counted",
          "[chained_source]") {
  const TemporaryFile a("(1700000000.000001) can0 001#11\n(1700000000.000002) can0 00", ".log");
  const TemporaryFile b("(1700000000.000003) can0 003#33\n", ".log");
  auto source = chain_can_logs({a.path(), b.path()}, "");
  REQUIRE(source.ok());
  std::vector<std::uint32_t> ids;
  std::array<CanFrame, 4> slots;
  for (SourceRead read = (*source)->read(slots, {}); read.state == SourceState::kData;
       read = (*source)->read(slots, {})) {
    for (const CanFrame& frame : std::span(slots).first(read.count)) ids.push_back(frame.id);
  }
  CHECK(ids == std::vector<std::uint32_t>{1, 3});
  CHECK((*source)->stats().malformed == 1);
}

TEST_CASE("a received packet is written with its sender and ports, and reads back unchanged",
          "[chained_source]") {
  Packet packet;
  packet.stamp.ns = kEpochNs + 987'654'321;
  packet.sender_address = 0x0A010203;
  packet.sender_port = 4321;
  packet.destination_port = 8308;
  packet.size = 512;
  for (std::size_t i = 0; i < packet.size; ++i) packet.data[i] = static_cast<std::uint8_t>(i * 7);
  std::vector<std::uint8_t> bytes;
  append_pcap_header(bytes);
  REQUIRE(append_pcap_record(bytes, packet));
  const TemporaryFile file(std::string(bytes.begin(), bytes.end()), ".pcap");
  auto source = open_pcap(file.path(), {});
  REQUIRE(source.ok());
  std::array<Packet, 2> slots;
  REQUIRE((*source)->read(slots, {}).count == 1);
  CHECK(slots[0].stamp == packet.stamp);
  CHECK(slots[0].sender_address == packet.sender_address);
  CHECK(slots[0].sender_port == packet.sender_port);
  CHECK(slots[0].destination_port == packet.destination_port);
  CHECK(slots[0].size == packet.size);
  CHECK(std::equal(packet.data.begin(), packet.data.begin() + packet.size, slots[0].data.begin()));
}

TEST_CASE("a datagram that did not fit its slot is written as captured in part", "[chained_source]") {
  Packet packet;
  packet.stamp.ns = kEpochNs;
  packet.size = kPacketCapacity;
  packet.truncated = true;
  std::vector<std::uint8_t> bytes;
  REQUIRE(append_pcap_record(bytes, packet));
  const auto length_at = [&](std::size_t at) { return bytes[at] + 256 * bytes[at + 1]; };
  CHECK(length_at(8) == 42 + kPacketCapacity);
  CHECK(length_at(12) == 42 + kPacketCapacity + 1);
  CHECK(bytes.size() == 16 + 42 + kPacketCapacity);
}
