#include "tests/support/capture_bytes.hpp"
#include "tests/support/pcap_support.hpp"

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::drivers;
using namespace nilio::tests;
using Catch::Matchers::Contains;

namespace {

constexpr std::uint16_t kPort = 2368;
constexpr std::int64_t kStampNs = kEpochNs + 123'456'789;

std::string frame_of(int link_type, std::string_view payload = "payload", std::uint8_t host = 201) {
  return link_frame(link_type, ipv4_udp(kPort, payload, host));
}

std::string text_of(const Packet& packet) { return {packet.data.begin(), packet.data.begin() + packet.size}; }

}  // namespace

TEST_CASE("captures of every link type are read", "[pcap_formats]") {
  for (const int link :
       {kLinkNull, kLinkEthernet, kLinkRaw, kLinkLoop, kLinkCooked, kLinkIpv4, kLinkCooked2}) {
    for (const bool next_generation : {false, true}) {
      const std::string bytes =
          next_generation ? PcapngText().interface(link).packet(0, kStampNs / 1000, frame_of(link)).bytes()
                          : PcapText(link).packet(kStampNs, frame_of(link)).bytes();
      INFO("link type " << link << (next_generation ? " in pcapng" : " in pcap"));
      const CaptureContents contents = read_capture(bytes);
      REQUIRE(contents.packets.size() == 1);
      CHECK(text_of(contents.packets[0]) == "payload");
      CHECK(contents.packets[0].sender_address == 0xC0A801C9);
      CHECK(contents.packets[0].stamp.ns == (next_generation ? kStampNs / 1000 * 1000 : kStampNs));
      CHECK(contents.state == SourceState::kEnd);
    }
  }
}

TEST_CASE("a loopback capture of a machine with the other byte order is read, other families are not",
          "[pcap_formats]") {
  const std::string ip = ipv4_udp(kPort, "payload");
  const std::string swapped = ByteText(true).u32(2).text(ip).bytes();
  const std::string version_6 = ByteText(true).u32(30).text(ip).bytes();
  CHECK(read_capture(PcapText(kLinkNull).packet(0, swapped).bytes()).packets.size() == 1);
  CHECK(read_capture(PcapText(kLinkNull).packet(0, version_6).bytes()).stats.other == 1);
  CHECK(read_capture(PcapText(kLinkNull).packet(0, "\x02").bytes()).stats.other == 1);
}

TEST_CASE("stacked VLAN tags are skipped on every link type that has them", "[pcap_formats]") {
  const std::string ip = ipv4_udp(kPort, "payload");
  const std::string tags = ByteText(true).u16(0x8100).u16(5).u16(0x88A8).u16(6).u16(0x9100).u16(7).bytes();
  const std::string rest = ByteText(true).u16(0x0800).text(ip).bytes();
  const std::string ethernet = std::string(12, '\0') + tags + rest;
  const std::string cooked = std::string(14, '\0') + tags + rest;
  CHECK(read_capture(PcapText(kLinkEthernet).packet(0, ethernet).bytes()).packets.size() == 1);
  CHECK(read_capture(PcapText(kLinkCooked).packet(0, cooked).bytes()).packets.size() == 1);
  for (std::size_t length = 0; length < 12 + tags.size() + 2; ++length) {
    CHECK(
        read_capture(PcapText(kLinkEthernet).packet(0, ethernet.substr(0, length)).bytes()).packets.empty());
  }
}

TEST_CASE("both byte orders and both resolutions of a capture give its stamps", "[pcap_formats]") {
  for (const bool big_endian : {false, true}) {
    for (const bool nanoseconds : {false, true}) {
      PcapText capture(kLinkEthernet, big_endian, nanoseconds);
      capture.packet(kStampNs, frame_of(kLinkEthernet)).packet(kStampNs + 1000, frame_of(kLinkEthernet));
      const CaptureContents contents = read_capture(capture.bytes());
      REQUIRE(contents.packets.size() == 2);
      const std::int64_t expected = nanoseconds ? kStampNs : kStampNs / 1000 * 1000;
      CHECK(contents.packets[0].stamp.ns == expected);
      CHECK(contents.packets[1].stamp.ns == expected + 1000);
    }
  }
}

TEST_CASE("pcapng stamps are read in every resolution, with offsets, in both byte orders", "[pcap_formats]") {
  const std::string frame = frame_of(kLinkEthernet);
  struct Clock {
    std::uint8_t resolution;
    std::uint64_t ticks;
    std::int64_t expected_ns;
  };
  const std::vector<Clock> clocks{
      {6, 1'700'000'000'123'456, 1'700'000'000'123'456'000},
      {9, 1'700'000'000'123'456'789, 1'700'000'000'123'456'789},
      {0, 1'700'000'000, 1'700'000'000'000'000'000},
      {3, 1'700'000'000'123, 1'700'000'000'123'000'000},
      {12, 5'123'456'789'987, 5'123'456'789},
      {19, 12'345'678'901'234'567'890U, 1'234'567'890},
      {0x80 | 10, 1'700'000'000ULL * 1024 + 512, 1'700'000'000'500'000'000},
      {0x80 | 32, (5ULL << 32) + (1ULL << 31), 5'500'000'000},
      {0x80 | 63, 3ULL << 62, 1'500'000'000},
  };
  for (const bool big_endian : {false, true}) {
    for (const Clock& clock : clocks) {
      PcapngText capture(big_endian);
      capture.interface(
          kLinkEthernet,
          capture.option(2, "eth0") + capture.option(9, std::string(1, static_cast<char>(clock.resolution))));
      capture.packet(0, clock.ticks, frame);
      INFO("resolution " << int{clock.resolution});
      const CaptureContents contents = read_capture(capture.bytes());
      REQUIRE(contents.packets.size() == 1);
      CHECK(contents.packets[0].stamp.ns == clock.expected_ns);
    }
    PcapngText shifted(big_endian);
    const std::string hour = ByteText(true).u32(0).u32(3600).bytes();
    const std::string offset = big_endian ? hour : std::string(hour.rbegin(), hour.rend());
    shifted.interface(kLinkEthernet, shifted.option(14, offset)).packet(0, 1'000'000, frame);
    CHECK(read_capture(shifted.bytes()).packets.at(0).stamp.ns == 3'601'000'000'000);
  }
}

TEST_CASE("invalid stamps and interfaces affect only their own packets", "[pcap_formats]") {
  const std::string frame = frame_of(kLinkEthernet);
  PcapngText capture;
  capture.interface(kLinkEthernet, capture.option(9, "\x14"));
  capture.interface(kLinkEthernet, capture.option(9, std::string(1, '\0')));
  capture.interface(kLinkEthernet);
  capture.packet(0, 5, frame);                  // 10^-20 s
  capture.packet(1, ~std::uint64_t{0}, frame);  // beyond the year 2500
  capture.packet(3, 5, frame);                  // no such interface
  capture.block(6, "four").block(2, "").block(3, "");
  capture.packet(2, 5, frame);
  const CaptureContents contents = read_capture(capture.bytes());
  CHECK(contents.packets.size() == 1);
  CHECK(contents.stats.malformed == 6);
  CHECK(contents.state == SourceState::kEnd);
}

TEST_CASE("pcapng with interfaces of the same and of different link types, and several sections, is read",
          "[pcap_formats]") {
  PcapngText capture;
  capture.interface(kLinkCan).interface(kLinkEthernet).interface(kLinkEthernet).interface(kLinkCooked2);
  capture.packet(0, 1, std::string(16, '\0'));
  capture.packet(1, 2, frame_of(kLinkEthernet, "one"));
  capture.block(5, "interface statistics");
  capture.packet(2, 3, frame_of(kLinkEthernet, "two"));
  capture.packet(3, 4, frame_of(kLinkCooked2, "three"));
  capture.section(true).interface(kLinkRaw, {}).packet(0, 5, frame_of(kLinkRaw, "four"));
  const CaptureContents contents = read_capture(capture.bytes());
  REQUIRE(contents.packets.size() == 4);
  const std::vector<std::string> expected{"one", "two", "three", "four"};
  for (std::size_t i = 0; i < 4; ++i) {
    CHECK(text_of(contents.packets[i]) == expected[i]);
    CHECK(contents.packets[i].stamp.ns == static_cast<std::int64_t>(i + 2) * 1000);
  }
  CHECK(contents.stats.other == 1);
  CHECK(contents.stats.malformed == 0);
}

TEST_CASE("older packet blocks of pcapng are read", "[pcap_formats]") {
  const std::string frame = frame_of(kLinkEthernet);
  PcapngText capture;
  capture.interface(kLinkEthernet).packet(0, 7, frame).simple_packet(frame);
  ByteText obsolete(false);
  obsolete.u16(0).u16(3).u32(0).u32(9).u32(frame.size()).u32(frame.size()).text(frame).pad(4);
  capture.block(2, obsolete.bytes());
  const CaptureContents contents = read_capture(capture.bytes());
  REQUIRE(contents.packets.size() == 3);
  CHECK(contents.packets[1].stamp.ns == 7000);
  CHECK(contents.packets[2].stamp.ns == 9000);
}

TEST_CASE("a pcapng file truncated at any byte delivers the packets before it and reports it",
          "[pcap_formats]") {
  PcapngText capture;
  const std::string head = capture.interface(kLinkEthernet).bytes();
  const std::string first = capture.packet(0, 1, frame_of(kLinkEthernet)).bytes();
  const std::string whole = capture.packet(0, 2, frame_of(kLinkEthernet)).bytes();
  for (std::size_t length = first.size() + 1; length < whole.size(); ++length) {
    const CaptureContents contents = read_capture(whole.substr(0, length));
    CHECK(contents.packets.size() == 1);
    CHECK(contents.state == SourceState::kEnd);
    CHECK(contents.stats.malformed == 1);
    CHECK_THAT(contents.status, Contains("ends in the middle of a packet"));
  }
  CHECK(read_capture(first).stats.malformed == 0);
  for (std::size_t length = 4; length < head.size(); ++length) {
    CHECK(read_capture(whole.substr(0, length)).packets.empty());
  }
}

TEST_CASE("a damaged pcapng file fails where the damage is", "[pcap_formats]") {
  PcapngText capture;
  capture.interface(kLinkEthernet).packet(0, 1, frame_of(kLinkEthernet));
  const std::string good = capture.bytes();
  const std::string place = "at byte " + std::to_string(good.size());
  const auto damaged = [&](const std::string& more) {
    const CaptureContents contents = read_capture(good + more);
    CHECK(contents.packets.size() == 1);
    CHECK(contents.state == SourceState::kFailed);
    CHECK_THAT(contents.status, Contains(place) && Contains("damaged"));
  };
  damaged(ByteText(false).u32(6).u32(8).u32(8).bytes());
  damaged(ByteText(false).u32(6).u32(17).text("abcdefghijklmnop").bytes());
  damaged(ByteText(false).u32(6).u32(12).u32(16).bytes());
  damaged(ByteText(false).u32(0x0A0D0D0A).u32(28).u32(0).bytes());
  damaged(ByteText(false).u32(0x0A0D0D0A).u32(16).u32(0x1A2B3C4D).u32(16).bytes());
  damaged(ByteText(false).u32(1).u32(12).u32(12).bytes());
  const auto refused = [](const std::string& bytes) {
    const TemporaryFile file(bytes, ".pcapng");
    return open_pcap(file.path(), {}).error().message;
  };
  CHECK_THAT(refused("\nno capture"), Contains("begins like pcapng, but is not"));
  CHECK_THAT(refused("\n"), Contains("begins like pcapng, but is not"));
}

TEST_CASE("packets longer than the buffer are skipped and the next ones are read", "[pcap_formats]") {
  PcapngText capture;
  capture.interface(kLinkEthernet).packet(0, 1, frame_of(kLinkEthernet) + std::string(400'000, 'x'));
  capture.block(77, std::string(500'000, 'y')).packet(0, 2, frame_of(kLinkEthernet));
  const CaptureContents contents = read_capture(capture.bytes());
  CHECK(contents.packets.size() == 2);
  CHECK(contents.state == SourceState::kEnd);
}

TEST_CASE("packets cut short by the recording are malformed, and status() names the option that avoids it",
          "[pcap_formats]") {
  const std::string frame = frame_of(kLinkEthernet, std::string(1206, 'x'));
  PcapText classic(kLinkEthernet);
  PcapngText next_generation;
  next_generation.interface(kLinkEthernet);
  for (const std::size_t kept : {std::size_t{30}, std::size_t{96}, frame.size() - 1, frame.size()}) {
    classic.packet(0, frame.substr(0, kept), frame.size());
    next_generation.packet(0, 0, frame.substr(0, kept), frame.size());
  }
  // Only the trailer of the link layer is missing.
  classic.packet(0, frame, frame.size() + 4);
  next_generation.packet(0, 0, frame, frame.size() + 4);
  for (const std::string& bytes : {classic.bytes(), next_generation.bytes()}) {
    const CaptureContents contents = read_capture(bytes);
    CHECK(contents.packets.size() == 2);
    CHECK(contents.stats.malformed == 3);
    CHECK_THAT(contents.status,
               Contains("3 malformed, of which 3 were cut short") && Contains("tcpdump -s 0"));
  }
}

TEST_CASE("fragments are counted and reported, not delivered", "[pcap_formats]") {
  PcapText capture(kLinkEthernet);
  capture.packet(0, link_frame(kLinkEthernet, ipv4_udp(kPort, "first", 201, 0x2000)));
  capture.packet(0, link_frame(kLinkEthernet, ipv4_udp(kPort, "last", 201, 0x0001)));
  capture.packet(0, frame_of(kLinkEthernet));
  const CaptureContents contents = read_capture(capture.bytes());
  CHECK(contents.packets.size() == 1);
  CHECK(contents.stats.other == 2);
  CHECK_THAT(contents.status, Contains("2 fragments of datagrams") && Contains("MTU"));
}

TEST_CASE("several sensors in one capture are separated by the sender's address", "[pcap_formats]") {
  PcapText capture(kLinkEthernet);
  for (int i = 0; i < 5; ++i) capture.packet(i, frame_of(kLinkEthernet, "left", 201));
  for (int i = 0; i < 3; ++i) capture.packet(i, frame_of(kLinkEthernet, "right", 202));
  const CaptureContents all = read_capture(capture.bytes());
  CHECK(all.packets.size() == 8);
  CHECK_THAT(all.status, Contains("several sensors are mixed (5 from 192.168.1.201, 3 from 192.168.1.202)"));
  const CaptureContents right = read_capture(capture.bytes(), {.sender_address = "192.168.1.202"});
  REQUIRE(right.packets.size() == 3);
  CHECK(text_of(right.packets[0]) == "right");
  CHECK(right.stats.other == 5);
  CHECK_THAT(right.status, Contains("only those from 192.168.1.202"));
  const CaptureContents none = read_capture(capture.bytes(), {.sender_address = "192.168.1.203"});
  CHECK(none.packets.empty());
  CHECK_THAT(none.status, Contains("5 from 192.168.1.201, 3 from 192.168.1.202") &&
                              Contains("set the sender address to one of these"));
  const TemporaryFile file(capture.bytes(), ".pcap");
  CHECK_THAT(open_pcap(file.path(), {.sender_address = "left"}).error().message,
             Contains(file.path()) && Contains("'left' is no IPv4 address"));
}

TEST_CASE("the status of a capture of one sensor does not mention several", "[pcap_formats]") {
  PcapText capture(kLinkEthernet);
  capture.packet(0, frame_of(kLinkEthernet)).packet(1, link_frame(kLinkEthernet, ipv4_udp(53, "name", 7)));
  const CaptureContents contents = read_capture(capture.bytes());
  CHECK_THAT(contents.status, !Contains("several sensors") && Contains("1 to port 53"));
}

TEST_CASE("without a position port its packets are other traffic", "[pcap_formats]") {
  PcapText capture(kLinkEthernet);
  capture.packet(0, frame_of(kLinkEthernet));
  capture.packet(0, link_frame(kLinkEthernet, ipv4_udp(8308, "position")));
  capture.packet(0, link_frame(kLinkEthernet, ipv4_udp(0, "nothing")));
  CHECK(read_capture(capture.bytes()).packets.size() == 2);
  const CaptureContents contents = read_capture(capture.bytes(), {.position_port = 0});
  CHECK(contents.packets.size() == 1);
  CHECK(contents.stats.other == 2);
}

TEST_CASE("the status of a capture without readable packets names its link types", "[pcap_formats]") {
  PcapngText capture;
  capture.interface(kLinkCan).packet(0, 1, std::string(16, '\0')).packet(0, 2, std::string(16, '\0'));
  const CaptureContents contents = read_capture(capture.bytes());
  CHECK(contents.packets.empty());
  CHECK_THAT(contents.status, Contains("2 of link type CAN_SOCKETCAN"));
}
