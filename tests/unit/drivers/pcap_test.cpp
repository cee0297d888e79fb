#include "nilio/drivers/capture/pcap.hpp"

#include "tests/support/pcap_support.hpp"
#include "tests/support/temporary_folder.hpp"

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::drivers;
using Catch::Matchers::Contains;
using nilio::tests::CaptureContents;
using nilio::tests::read_capture;
using nilio::tests::read_file;
using nilio::tests::TemporaryFile;

namespace {

/// A capture of `count` datagrams of 100 bytes to `port`, one second apart.
std::string capture(std::size_t count, std::uint16_t port) {
  const TemporaryFile file("", ".pcap");
  auto writer = PcapWriter::create(file.path());
  REQUIRE(writer.ok());
  std::vector<std::uint8_t> payload(100);
  for (std::size_t i = 0; i < count; ++i) {
    payload[0] = static_cast<std::uint8_t>(i);
    REQUIRE(writer->write({nilio::tests::kEpochNs + static_cast<std::int64_t>(i) * 1'000'000'000 + 123}, port,
                          payload));
  }
  REQUIRE(writer->close());
  return read_file(file.path());
}

std::string open_error(const std::string& bytes) {
  const TemporaryFile file(bytes, ".pcap");
  const auto source = open_pcap(file.path(), {});
  REQUIRE_FALSE(source.ok());
  CHECK_THAT(source.error().message, Contains(file.path()));
  return source.error().message;
}

constexpr std::size_t kFileHeader = 24;
constexpr std::size_t kRecordHeader = 16;
constexpr std::size_t kLinkHeader = 14;

/// Replaces the first record's frame and sets the link type.
std::string with_frame(std::string bytes, std::uint8_t link_type, const std::string& frame) {
  bytes.resize(kFileHeader + kRecordHeader);
  bytes[20] = static_cast<char>(link_type);
  for (const std::size_t at : {kFileHeader + 8, kFileHeader + 12}) {
    bytes[at] = static_cast<char>(frame.size() & 0xFF);
    bytes[at + 1] = static_cast<char>(frame.size() >> 8);
  }
  return bytes + frame;
}

}  // namespace

TEST_CASE("a written capture reads back with nanoseconds, ports and addresses", "[pcap]") {
  const CaptureContents contents = read_capture(capture(7, 2368));
  REQUIRE(contents.packets.size() == 7);
  CHECK(contents.state == SourceState::kEnd);
  for (std::size_t i = 0; i < 7; ++i) {
    const Packet& packet = contents.packets[i];
    CHECK(packet.stamp.ns == nilio::tests::kEpochNs + static_cast<std::int64_t>(i) * 1'000'000'000 + 123);
    CHECK(packet.size == 100);
    CHECK(packet.data[0] == i);
    CHECK(packet.destination_port == 2368);
    CHECK(packet.sender_address == 0xC0A801C9);
    CHECK(packet.received_ns > 0);
    CHECK_FALSE(packet.truncated);
  }
  CHECK(contents.stats.delivered == 7);
}

TEST_CASE("records that a capture cannot hold are rejected", "[pcap]") {
  const TemporaryFile file("", ".pcap");
  auto writer = PcapWriter::create(file.path());
  REQUIRE(writer.ok());
  const std::vector<std::uint8_t> large(65508);
  CHECK_FALSE(writer->write({nilio::tests::kEpochNs}, 2368, large));
  CHECK_FALSE(writer->write({-1}, 2368, std::span(large).first(10)));
  CHECK(writer->write({nilio::tests::kEpochNs}, 2368, std::span(large).first(65507)));
  CHECK(writer->close());
  CHECK(read_file(file.path()).size() == kFileHeader + kRecordHeader + 42 + 65507);
  CHECK_FALSE(PcapWriter::create(file.path() + "/x.pcap").ok());
}

TEST_CASE("datagrams longer than a slot are cut and marked", "[pcap]") {
  const TemporaryFile file("", ".pcap");
  auto writer = PcapWriter::create(file.path());
  REQUIRE(writer.ok());
  REQUIRE(writer->write({nilio::tests::kEpochNs}, 2368, std::vector<std::uint8_t>(2000, 9)));
  REQUIRE(writer->close());
  const CaptureContents contents = read_capture(read_file(file.path()));
  REQUIRE(contents.packets.size() == 1);
  CHECK(contents.packets[0].truncated);
  CHECK(contents.packets[0].size == kPacketCapacity);
}

TEST_CASE("a capture truncated in the middle of a packet delivers the complete ones and reports it",
          "[pcap]") {
  const std::string bytes = capture(5, 2368);
  const CaptureContents contents = read_capture(bytes.substr(0, bytes.size() - 50));
  CHECK(contents.packets.size() == 4);
  CHECK(contents.state == SourceState::kEnd);
  CHECK(contents.stats.malformed == 1);
  CHECK_THAT(contents.status, Contains("ends in the middle of a packet"));
}

TEST_CASE("the status of a capture with other ports only names them and the setting", "[pcap]") {
  const CaptureContents contents = read_capture(capture(5, 2369));
  CHECK(contents.packets.empty());
  CHECK(contents.state == SourceState::kEnd);
  CHECK(contents.stats.other == 5);
  CHECK_THAT(contents.status,
             Contains("5 to port 2369") && Contains("2368") && Contains("set the LiDAR's port"));
}

TEST_CASE("files that are no captures are rejected with the reason", "[pcap]") {
  CHECK_THAT(open_error(""), Contains("empty (0 bytes)"));
  CHECK_THAT(open_error("this is a text file, not a capture"), Contains("no capture"));
  CHECK_THAT(open_error(capture(1, 2368).substr(0, 10)), Contains("no capture"));
  const auto missing = open_pcap("/nonexistent/x.pcap", {});
  REQUIRE_FALSE(missing.ok());
  CHECK_THAT(missing.error().message, Contains("/nonexistent/x.pcap") && Contains("no such file"));
  std::string wifi = capture(1, 2368);
  wifi[20] = 105;
  CHECK_THAT(open_error(wifi), Contains("IEEE802_11"));
  CHECK_THAT(open_pcap("/", {}).error().message, Contains("folder"));
}

TEST_CASE("every header length in a capture is checked", "[pcap]") {
  const std::string bytes = capture(1, 2368);
  const std::size_t ip = kFileHeader + kRecordHeader + kLinkHeader;
  std::string changed = bytes;
  changed[ip + 2] = 4;  // IP total length: too large, but not used
  CHECK(read_capture(changed).packets.size() == 1);
  changed = bytes;
  changed[ip] = 0x4F;  // a header of 60 bytes: UDP is read from the payload
  CHECK(read_capture(changed).packets.empty());
  changed = bytes;
  changed[ip] = 0x41;
  CHECK(read_capture(changed).stats.malformed == 1);
  changed = bytes;
  changed[ip + 24] = 0;
  changed[ip + 25] = 3;  // UDP length below its own header
  CHECK(read_capture(changed).stats.malformed == 1);
  changed = bytes;
  changed[ip + 24] = '\xFF';  // UDP length beyond what was captured
  const CaptureContents beyond = read_capture(changed);
  REQUIRE(beyond.packets.size() == 1);
  CHECK(beyond.packets[0].size == 100);
  const std::string frame = bytes.substr(kFileHeader + kRecordHeader);
  for (std::size_t length = 1; length < 42; ++length) {
    CHECK(read_capture(with_frame(bytes, 1, frame.substr(0, length))).packets.empty());
  }
}
