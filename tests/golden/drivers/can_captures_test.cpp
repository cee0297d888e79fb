// CAN frames in every kind of capture that can hold LiDAR and CAN.

#include "nilio/drivers/can/can_files.hpp"
#include "nilio/drivers/capture/pcap.hpp"
#include "nilio/drivers/imu/decoder.hpp"

#include "tests/support/can_contents.hpp"
#include "tests/support/capture_bytes.hpp"
#include "tests/support/imu_support.hpp"
#include "tests/support/pcap_support.hpp"

using namespace nilio;
using namespace nilio::drivers;
using namespace nilio::tests;
using Catch::Matchers::Contains;

namespace {

CanContents read_can(const std::string& path, const std::string& interface_name) {
  return contents_of(open_can_capture(path, interface_name));
}

CanContents read_can_bytes(const std::string& bytes, const std::string& interface_name = "") {
  const TemporaryFile file(bytes, ".pcap");
  return read_can(file.path(), interface_name);
}

constexpr std::uint32_t kExtendedFlag = 0x80000000U;
constexpr std::uint32_t kRemoteFlag = 0x40000000U;
constexpr std::uint32_t kErrorFlag = 0x20000000U;

/// A frame of SocketCAN: 16 bytes, or 72 for CAN FD. The identifier is in network order for the link type
/// SocketCAN, and in the byte order of the capturing machine after cooked headers.
std::string can(std::uint32_t id, const std::string& data, bool big_endian_id, bool flexible = false,
                std::uint8_t flags = 0) {
  ByteText text(big_endian_id);
  const std::string lengths{static_cast<char>(data.size()), static_cast<char>(flags), '\0', '\0'};
  text.u32(id).text(lengths).text(data);
  return text.text(std::string((flexible ? 72 : 16) - 8 - data.size(), '\0')).bytes();
}

std::string cooked(std::uint16_t protocol, const std::string& frame) {
  return ByteText(true).u16(1).u16(280).u16(0).u32(0).u32(0).u16(protocol).text(frame).bytes();
}

std::string cooked2(std::uint16_t protocol, std::uint32_t interface, const std::string& frame) {
  return ByteText(true).u16(protocol).u16(0).u32(interface).u16(280).u16(0).u32(0).u32(0).text(frame).bytes();
}

const std::string kRate{"\x01\x00\xFF\x80\x02\x00", 6};
const std::string kAcceleration{"\x00\x00\x00\x00\x09\xCF", 6};

}  // namespace

TEST_CASE("captures of a CAN interface give frames of every kind", "[can_captures]") {
  PcapText capture(kLinkCan);
  capture.packet(kEpochNs + 1, can(0x32, kRate, true))
      .packet(kEpochNs + 2, can(0x1ABCDEF0U | kExtendedFlag, "x", true))
      .packet(kEpochNs + 3, can(0x123U | kRemoteFlag, "", true))
      .packet(kEpochNs + 4, can(0x4U | kErrorFlag, std::string(8, '\0'), true))
      .packet(kEpochNs + 5, can(0x7FF, std::string(64, 'y'), true, true))
      .packet(kEpochNs + 6, can(0x7FE, "FD", true, true, 0))
      // Without the unused bytes; the flag marks CAN FD.
      .packet(kEpochNs + 7, can(0x7FD, std::string(12, 'z'), true, true, 4).substr(0, 20));
  const CanContents contents = read_can_bytes(capture.bytes(), "can0");
  REQUIRE(contents.frames.size() == 7);
  CHECK(contents.state == SourceState::kEnd);
  CHECK(contents.stats.malformed == 0);
  const std::vector<CanFrame>& frames = contents.frames;
  CHECK(frames[0].stamp.ns == kEpochNs + 1);
  CHECK(frames[0].received_ns > 0);
  CHECK(frames[0].id == 0x32);
  CHECK(bytes_of(frames[0]) == std::vector<std::uint8_t>(kRate.begin(), kRate.end()));
  CHECK_FALSE((frames[0].extended || frames[0].flexible_data_rate));
  CHECK(frames[1].extended);
  CHECK(frames[1].id == 0x1ABCDEF0);
  CHECK(frames[2].remote);
  CHECK(frames[3].error);
  CHECK(frames[3].id == 4);
  CHECK(frames[4].flexible_data_rate);
  CHECK(frames[4].length == 64);
  CHECK(frames[5].flexible_data_rate);
  CHECK(frames[6].flexible_data_rate);
  CHECK(frames[6].length == 12);
}

TEST_CASE("one capture of all interfaces provides LiDAR and IMU data", "[can_captures]") {
  const std::string lidar = link_frame(kLinkCooked2, ipv4_udp(2368, std::string(1206, 'v')));
  PcapText capture(kLinkCooked2);
  for (int i = 0; i < 10; ++i) {
    const std::int64_t stamp = kEpochNs + i * 10'000'000;
    capture.packet(stamp, lidar)
        .packet(stamp + 1000, cooked2(0x000C, 3, can(0x32, kRate, false)))
        .packet(stamp + 2000, cooked2(0x000C, 4, can(0x32, "otherbus", false)))
        .packet(stamp + 3000, cooked2(0x000C, 3, can(0x34, kAcceleration, false)));
  }
  const TemporaryFile file(capture.bytes(), ".pcap");
  auto packets = open_pcap(file.path(), {});
  REQUIRE(packets.ok());
  std::array<Packet, 32> slots;
  CHECK((*packets)->read(slots, {}).count == 10);
  CHECK(slots[9].stamp.ns == kEpochNs + 90'000'000);
  for (const char* interface_name : {"3", "can0"}) {
    CAPTURE(interface_name);
    const CanContents contents = read_can(file.path(), interface_name);
    CHECK(contents.frames.size() == 20);
    CHECK(contents.stats.other == 20);
    CHECK_THAT(contents.status, Contains("20 of #3") && Contains("10 of #4"));
    ImuDecoder decoder = decoder_of(preset_of("xsens_mti"));
    for (const CanFrame& frame : contents.frames) decoder.add(frame);
    CHECK(decoder.stats().samples == 10);
    CHECK(decoder.stats().incomplete == 0);
  }
  CHECK(read_can(file.path(), "4").frames.size() == 10);
  CHECK(read_can(file.path(), "").frames.size() == 30);
  const CanContents none = read_can(file.path(), "7");
  CHECK(none.frames.empty());
  CHECK_THAT(none.status,
             Contains("wanted '7'") && Contains("20 of #3") && Contains("set the CAN interface"));
}

TEST_CASE("the older cooked header carries CAN and CAN FD, too", "[can_captures]") {
  PcapText capture(kLinkCooked);
  capture.packet(1, cooked(0x000C, can(0x123, "abc", false)))
      .packet(2, cooked(0x000D, can(0x124, std::string(48, 'd'), false, true)))
      .packet(3, link_frame(kLinkCooked, ipv4_udp(2368, "lidar")))
      .packet(4, cooked(0x000C, can(0x125, "cut", false).substr(0, 9)))
      .packet(5, cooked(0x000C, "short"));
  const CanContents contents = read_can_bytes(capture.bytes(), "can0");
  REQUIRE(contents.frames.size() == 2);
  CHECK(contents.frames[0].id == 0x123);
  CHECK(contents.frames[1].flexible_data_rate);
  CHECK(contents.frames[1].length == 48);
  CHECK(contents.stats.other == 1);
  CHECK(contents.stats.malformed == 2);
}

TEST_CASE("a pcapng with LiDAR and CAN interfaces gives the frames of the named interface",
          "[can_captures]") {
  for (const bool big_endian : {false, true}) {
    CAPTURE(big_endian);
    PcapngText capture(big_endian);
    capture.interface(kLinkEthernet, capture.option(2, "eth0") + capture.option(9, "\x09"))
        .interface(kLinkCan, capture.option(9, "\x09") + capture.option(2, "can0"))
        .interface(kLinkCan, capture.option(2, "can1") + capture.option(9, "\x09"));
    for (int i = 0; i < 5; ++i) {
      const auto stamp = static_cast<std::uint64_t>(kEpochNs + i);
      capture.packet(0, stamp, link_frame(kLinkEthernet, ipv4_udp(2368, std::string(1206, 'v'))))
          .packet(1, stamp, can(0x100, "zero", true))
          .block(5, "statistics..")
          .packet(9, stamp, "of an interface that was never described")
          .packet(2, stamp, can(0x101, "one", true));
    }
    capture.simple_packet(link_frame(kLinkEthernet, ipv4_udp(2368, "simple")))
        .packet(2, 7, can(0x102, "", true));
    // A second section restarts the numbering of interfaces.
    capture.section(!big_endian)
        .interface(kLinkCan, capture.option(2, "can1"))
        .packet(0, 8, can(0x103, "", true));
    const TemporaryFile file(capture.bytes(), ".pcapng");
    auto packets = open_pcap(file.path(), {});
    REQUIRE(packets.ok());
    std::array<Packet, 32> slots;
    CHECK((*packets)->read(slots, {}).count == 6);
    const CanContents zero = read_can(file.path(), "can0");
    CHECK(zero.frames.size() == 5);
    CHECK(
        std::all_of(zero.frames.begin(), zero.frames.end(), [](const CanFrame& f) { return f.id == 0x100; }));
    const CanContents one = read_can(file.path(), "can1");
    REQUIRE(one.frames.size() == 7);
    CHECK(one.frames[4].id == 0x101);
    CHECK(one.frames[5].id == 0x102);
    CHECK(one.frames[6].id == 0x103);
    CHECK(one.stats.malformed == 5);
    CHECK(read_can(file.path(), "").frames.size() == 12);
    const CanContents none = read_can(file.path(), "can7");
    CHECK(none.frames.empty());
    CHECK_THAT(none.status, Contains("5 of can0") && Contains("7 of can1") && Contains("'can7'"));
  }
}

TEST_CASE("cooked frames of a big-endian machine have a big-endian identifier", "[can_captures]") {
  PcapngText capture(true);
  capture.interface(kLinkCooked2, capture.option(2, "any"));
  capture.packet(0, 1, cooked2(0x000C, 3, can(0x123, "abc", true)));
  const CanContents contents = read_can_bytes(capture.bytes());
  REQUIRE(contents.frames.size() == 1);
  CHECK(contents.frames[0].id == 0x123);
}

TEST_CASE("errors for files without CAN give the reason and the remedy", "[can_captures]") {
  const auto error_of = [](const std::string& path) {
    const auto source = open_can_capture(path, "");
    REQUIRE_FALSE(source.ok());
    return source.error().message;
  };
  CHECK_THAT(error_of("/nonexistent.pcap"), Contains("/nonexistent.pcap") && Contains("no such file"));
  CHECK_THAT(error_of("/tmp"), Contains("folder"));
  const TemporaryFile empty("", ".pcap");
  CHECK_THAT(error_of(empty.path()), Contains("empty"));
  const TemporaryFile text("no capture at all, only text of some length", ".pcap");
  CHECK_THAT(error_of(text.path()), Contains(text.path()) && Contains("no capture"));
  const TemporaryFile ethernet(PcapText(kLinkEthernet).bytes(), ".pcap");
  CHECK_THAT(error_of(ethernet.path()), Contains("EN10MB") && Contains("no CAN"));
  PcapText lidar(kLinkCooked2);
  lidar.packet(1, link_frame(kLinkCooked2, ipv4_udp(2368, "lidar")));
  CHECK_THAT(read_can_bytes(lidar.bytes()).status, Contains("0 CAN frames") && Contains("record with"));
  std::string cut = PcapText(kLinkCan).packet(1, can(1, "", true)).packet(2, can(2, "", true)).bytes();
  cut.pop_back();
  const CanContents contents = read_can_bytes(cut);
  CHECK(contents.frames.size() == 1);
  CHECK(contents.state == SourceState::kEnd);
  CHECK_THAT(contents.status, Contains("middle of a packet"));
}
